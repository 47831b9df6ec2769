//! Relighting on the GPU a matrix whose factors do not fit into its memory.

use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

use rayon::prelude::*;

use super::bank::Bank;
use super::device::Gpu;
use super::resident::{Output, ResidentBank, SharedArrays, read_back, run};
use super::{GpuSettings, binding_limit, too_large};
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::matrix::{BlockId, CHANNELS};
use crate::relight::cpu::check_columns;
use crate::relight::paged::PagedRelighter;
use crate::relight::pager::{Detail, Pager};
use crate::relight::tiles::for_each_tile;

/// Of the budget, the share of one bank: so much passes through while the rest stays.
const BANK_SHARE: u64 = 4;

/// Relights on the GPU within a budget of its memory: banks of blocks stay there as far as the budget goes, the others
/// pass through, bank by bank. Blocks come through a [`PagedRelighter`], so that host memory has its own budget.
pub struct PagedGpuRelighter<'a> {
    gpu: Gpu,
    host: PagedRelighter<'a>,
    shared: SharedArrays,
    /// Bytes of one array, and of all of a bank.
    binding_bytes: u64,
    bank_bytes: u64,
    state: Mutex<State>,
}

struct State {
    /// Blocks of each bank, as far as blocks have been seen.
    banks: Vec<Range<u32>>,
    pager: Pager<usize>,
    resident: HashMap<usize, ResidentBank>,
    uploads: u64,
    peak_bytes: u64,
}

impl<'a> PagedGpuRelighter<'a> {
    /// A relighter that takes at most `budget_bytes` of GPU memory. Uploads nothing yet.
    ///
    /// Errors: [`Error::NoGpu`] without a loader or an adapter; a lighting that does not fit.
    pub fn new(host: PagedRelighter<'a>, budget_bytes: u64, settings: GpuSettings) -> Result<Self> {
        let gpu = Gpu::open(settings.subgroups)?;
        let shape = host.shape();
        let binding_bytes = binding_limit(&gpu, shape, settings)?;
        let lighting_bytes = SharedArrays::lighting_bytes(shape.columns());
        let Some(budget_bytes) = budget_bytes.checked_sub(lighting_bytes) else {
            return Err(too_large("the lighting", lighting_bytes, budget_bytes));
        };
        let bank_bytes = budget_bytes / BANK_SHARE;
        let state = State {
            banks: Vec::new(),
            pager: Pager::new(budget_bytes - bank_bytes),
            resident: HashMap::new(),
            uploads: 0,
            peak_bytes: lighting_bytes,
        };
        let shared = SharedArrays::new(&gpu, shape.columns());
        Ok(Self { gpu, host, shared, binding_bytes, bank_bytes, state: Mutex::new(state) })
    }

    /// The image under `lighting`. One call at a time runs; others wait.
    ///
    /// Errors: a lighting with another number of columns than the matrix; what the source reports other than damage; a
    /// block that is larger than a quarter of the budget or than one binding; [`Error::NoGpu`] where the device fails.
    pub fn relight(&self, lighting: &Lighting) -> Result<LinearImage> {
        let shape = self.host.shape();
        check_columns(shape, lighting)?;
        let mut guard = self.state.lock().unwrap_or_else(PoisonError::into_inner);
        let state = &mut *guard;
        self.shared.set(&self.gpu, lighting, None);
        let mut pixels: Vec<Option<Vec<[f32; CHANNELS]>>> = vec![None; shape.block_count() as usize];
        let mut take = |bank: &ResidentBank, bytes: &[u8]| {
            let image: &[[f32; CHANNELS]] = bytemuck::cast_slice(bytes);
            for &(id, first) in &bank.places {
                let count = shape.rect(id).rows() / CHANNELS;
                pixels[id.index()] = Some(image[first as usize..][..count].to_vec());
            }
        };
        // Every bank is seen in every picture.
        state.pager.set_view(0..shape.block_count() as usize);
        let resident: Vec<&ResidentBank> = state.resident.values().collect();
        if !resident.is_empty() {
            run(&self.gpu, &resident, Output::Radiance)?;
            read_back(&self.gpu, &resident, &mut take)?;
        }
        let mut next_block = 0;
        for index in 0.. {
            if next_block == shape.block_count() {
                break;
            }
            if state.pager.touch(index).is_none() {
                let known = state.banks.get(index).cloned();
                let (bank, blocks) = self.gather(next_block, known)?;
                if index == state.banks.len() {
                    state.banks.push(blocks);
                }
                if !bank.blocks.is_empty() {
                    let bank = ResidentBank::upload(&self.gpu, &self.shared, shape.columns(), &bank)?;
                    state.uploads += 1;
                    let lighting_bytes = SharedArrays::lighting_bytes(shape.columns());
                    let bytes = state.pager.used_bytes() + bank.bytes + lighting_bytes;
                    state.peak_bytes = state.peak_bytes.max(bytes);
                    run(&self.gpu, &[&bank], Output::Radiance)?;
                    read_back(&self.gpu, &[&bank], &mut take)?;
                    if state.pager.admit(index, Detail::Whole, bank.bytes).kept {
                        state.resident.insert(index, bank);
                    }
                }
            }
            next_block = state.banks[index].end;
        }
        let mut image = LinearImage::black(shape.width(), shape.height());
        for_each_tile(&mut image, shape, |mut tile| {
            match &pixels[tile.id.index()] {
                Some(pixels) => tile.copy(pixels),
                None => tile.mark_as_hole(),
            }
            Ok::<_, Error>(())
        })?;
        Ok(image)
    }

    /// Packs the blocks of a bank: those of `known`, or as many from `first` on as fit.
    fn gather(&self, first: u32, known: Option<Range<u32>>) -> Result<(Bank, Range<u32>)> {
        let end = known.as_ref().map_or(self.host.shape().block_count(), |blocks| blocks.end);
        let mut bank = Bank::default();
        let mut next = first;
        while next < end {
            // So few that little is read twice where the bank ends.
            let batch = next..(next + rayon::current_num_threads() as u32).min(end);
            let read: Vec<_> = batch
                .into_par_iter()
                .map(|id| Ok((BlockId(id), self.host.fetch(BlockId(id), Detail::Whole)?)))
                .collect::<Result<_>>()?;
            for (id, held) in read {
                if let Some(block) = &held.block {
                    let (largest, whole) = (bank.largest_with(block), bank.bytes_with(block));
                    if largest > self.binding_bytes || whole > self.bank_bytes {
                        if bank.blocks.is_empty() {
                            let limit = self.binding_bytes.min(self.bank_bytes);
                            return Err(too_large(&id.to_string(), largest.max(whole), limit));
                        }
                        return Ok((bank, first..next));
                    }
                    bank.push(id, block);
                }
                next = id.0 + 1;
            }
        }
        Ok((bank, first..next))
    }

    /// Name of the adapter and its driver's interface.
    pub fn adapter(&self) -> String {
        self.gpu.name()
    }

    /// Whether the adapter is a processor in disguise, which the CPU path outruns.
    pub fn is_software(&self) -> bool {
        self.gpu.is_software()
    }

    /// The blocks' way through host memory: what was read, and what was damaged.
    pub fn host(&self) -> &PagedRelighter<'a> {
        &self.host
    }

    /// Banks uploaded so far.
    pub fn uploads(&self) -> u64 {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).uploads
    }

    /// Most bytes of GPU memory that buffers took at once.
    pub fn peak_bytes(&self) -> u64 {
        self.state.lock().unwrap_or_else(PoisonError::into_inner).peak_bytes
    }
}
