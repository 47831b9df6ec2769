//! Uploads from host to GPU memory through a few mapped buffers. They are reused, since making one costs as much as
//! sending what it holds. All threads fill one while the GPU empties another.

use std::ops::Range;

use rayon::prelude::*;

use super::device::Gpu;
use crate::error::{Error, Result};

/// Bytes of one staging buffer, so many that the cost of a submission is small beside filling it. Tuned: decision 40.
const SLOT_BYTES: usize = 8 << 20;
/// One is filled, one is emptied, and one is on its way back.
const SLOTS: usize = 3;
/// Bytes that one thread fills at a time.
const STRIPE_BYTES: usize = 64 << 10;

/// The buffers, made when they are first needed.
#[derive(Default)]
pub(super) struct Staging {
    slots: Vec<Slot>,
    /// Index of the buffer to use next.
    turn: usize,
}

struct Slot {
    buffer: wgpu::Buffer,
    /// What empties it; it is mapped when that is done.
    emptied_by: Option<wgpu::SubmissionIndex>,
}

/// Commands that follow what is sent, for [`Staging::submit`].
#[must_use]
pub(super) struct Sent {
    pub encoder: wgpu::CommandEncoder,
    /// The buffer that the commands read.
    slot: Option<usize>,
}

/// What one buffer on the GPU is to hold: pieces, one behind the other, of whole words together.
pub(super) struct Parcel<'a> {
    pub target: &'a wgpu::Buffer,
    pub pieces: Vec<&'a [u8]>,
}

/// A piece of a stream of bytes.
struct Piece<'a> {
    start: usize,
    bytes: &'a [u8],
}

impl Staging {
    /// Sends parcels. The last of them arrive with what is submitted next, which can be told to use them.
    pub(super) fn send(&mut self, gpu: &Gpu, parcels: &[Parcel]) -> Result<Sent> {
        let (mut stream, mut targets, mut end) = (Vec::new(), Vec::new(), 0);
        for Parcel { target, pieces } in parcels {
            let start = end;
            for bytes in pieces.iter().filter(|bytes| !bytes.is_empty()) {
                stream.push(Piece { start: end, bytes });
                end += bytes.len();
            }
            targets.push((*target, start..end));
        }
        let begin = || Sent { encoder: gpu.encoder(), slot: None };
        let mut sent = begin();
        for start in (0..end).step_by(SLOT_BYTES) {
            if sent.slot.is_some() {
                self.submit(gpu, std::mem::replace(&mut sent, begin()));
            }
            let part = start..end.min(start + SLOT_BYTES);
            let turn = self.next(gpu)?;
            let buffer = &self.slots[turn].buffer;
            fill(gpu, buffer, &stream, part.clone())?;
            buffer.unmap();
            for (target, range) in &targets {
                let (from, to) = (range.start.max(part.start), range.end.min(part.end));
                if from < to {
                    let [source, place] = [from - part.start, from - range.start].map(|at| at as u64);
                    sent.encoder.copy_buffer_to_buffer(buffer, source, target, place, (to - from) as u64);
                }
            }
            sent.slot = Some(turn);
        }
        Ok(sent)
    }

    /// Submits what was sent, and the commands that were added.
    pub(super) fn submit(&mut self, gpu: &Gpu, sent: Sent) -> wgpu::SubmissionIndex {
        let submission = gpu.queue.submit([sent.encoder.finish()]);
        if let Some(turn) = sent.slot {
            let slot = &mut self.slots[turn];
            slot.emptied_by = Some(submission.clone());
            slot.buffer.map_async(wgpu::MapMode::Write, .., |_| ());
        }
        submission
    }

    /// Gives the buffers' memory back.
    pub(super) fn release(&mut self) {
        *self = Self::default();
    }

    /// The place of the next buffer, which is mapped.
    fn next(&mut self, gpu: &Gpu) -> Result<usize> {
        let turn = self.turn;
        self.turn = (turn + 1) % SLOTS;
        if turn == self.slots.len() {
            let buffer = gpu.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("staging"),
                size: SLOT_BYTES as u64,
                usage: wgpu::BufferUsages::MAP_WRITE | wgpu::BufferUsages::COPY_SRC,
                mapped_at_creation: true,
            });
            self.slots.push(Slot { buffer, emptied_by: None });
        }
        if let Some(submission) = self.slots[turn].emptied_by.take() {
            gpu.wait_for(submission)?;
        }
        Ok(turn)
    }
}

/// Fills a mapped buffer with a part of the stream, on all threads.
fn fill(gpu: &Gpu, buffer: &wgpu::Buffer, stream: &[Piece], part: Range<usize>) -> Result<()> {
    let mut mapped = buffer
        .get_mapped_range_mut(..)
        .map_err(|e| Error::NoGpu(format!("{}: what is sent to it cannot be written ({e})", gpu.adapter.name)))?;
    let (stripes, _) = mapped.slice(..).into_chunks::<STRIPE_BYTES>();
    let starts = part.clone().step_by(STRIPE_BYTES);
    let stripes: Vec<_> = stripes.into_iter().zip(starts).collect();
    stripes.into_par_iter().for_each(|(stripe, start)| {
        let mut stripe = wgpu::WriteOnly::<[u8]>::from(stripe);
        let end = part.end.min(start + STRIPE_BYTES);
        let first = stream.partition_point(|piece| piece.start + piece.bytes.len() <= start);
        for piece in stream[first..].iter().take_while(|piece| piece.start < end) {
            let (from, to) = (start.max(piece.start), end.min(piece.start + piece.bytes.len()));
            stripe.slice(from - start..to - start).copy_from_slice(&piece.bytes[from - piece.start..to - piece.start]);
        }
    });
    Ok(())
}
