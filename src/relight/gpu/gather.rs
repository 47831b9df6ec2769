//! Blocks on their way from the host into banks: read in parallel, split where they are too large, none read twice.

use std::collections::VecDeque;
use std::ops::Range;
use std::sync::Arc;

use rayon::prelude::*;

use super::bank::{Bank, Lengths, Packed};
use super::too_large;
use crate::error::Result;
use crate::matrix::BlockId;
use crate::relight::compact::CompactBlock;
use crate::relight::paged::{HeldBlock, PagedRelighter};
use crate::relight::pager::Detail;

/// Number of sparse entries up to which one thread packs a block. With more, all threads do. Tuned: decision 39.
const FEW_ENTRIES: usize = 4096;

/// Limits of a bank.
#[derive(Clone, Copy, Debug)]
pub(super) struct Limits {
    /// Bytes of one array.
    pub binding_bytes: u64,
    /// Bytes of all arrays of a bank.
    pub bank_bytes: u64,
    /// The same of a bank that holds nothing but one component of a block, which cannot be made smaller.
    pub most_bytes: u64,
}

/// Blocks packed for the GPU.
pub(super) struct PackedBanks {
    pub bank: Bank,
    pub blocks: Vec<Arrived>,
    /// Whether it holds one piece of a block that did not fit as a whole: pieces add up to the block.
    pub is_piece: bool,
}

/// A block that has come.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrived {
    pub id: BlockId,
    pub detail: Detail,
    /// Whether nothing of it could be read.
    pub is_hole: bool,
}

/// A block that was read, none where nothing could be, and the same as the kernels read it.
struct Waiting {
    id: BlockId,
    detail: Detail,
    block: Option<(Arc<CompactBlock>, Packed)>,
}

/// Packs blocks bank by bank in the order in which they are wanted.
pub(super) struct BankPacker<'a, 's> {
    /// Where each tile begins in a plane of the lighting.
    firsts: &'a [u32],
    host: &'a PagedRelighter<'s>,
    wanted: VecDeque<(BlockId, Detail)>,
    /// Read and not yet in a bank.
    waiting: VecDeque<Waiting>,
    pieces: VecDeque<(BlockId, Detail, Arc<CompactBlock>)>,
    limits: Limits,
}

impl<'a, 's> BankPacker<'a, 's> {
    pub(super) fn new(
        firsts: &'a [u32],
        host: &'a PagedRelighter<'s>,
        wanted: impl IntoIterator<Item = (BlockId, Detail)>,
        limits: Limits,
    ) -> Self {
        let wanted = wanted.into_iter().collect();
        Self { firsts, host, wanted, waiting: VecDeque::new(), pieces: VecDeque::new(), limits }
    }

    /// The next bank; none when all have come.
    ///
    /// # Errors
    /// What the source reports other than damage, and a block one component of which does not fit.
    pub(super) fn next(&mut self) -> Result<Option<PackedBanks>> {
        if let Some((id, detail, piece)) = self.pieces.pop_front() {
            return Ok(Some(self.piece(id, detail, &piece)));
        }
        let mut gathered = PackedBanks { bank: Bank::default(), blocks: Vec::new(), is_piece: false };
        loop {
            if self.waiting.is_empty() {
                self.read()?;
            }
            let Some(Waiting { id, detail, block }) = self.waiting.pop_front() else { break };
            let arrived = Arrived { id, detail, is_hole: block.is_none() };
            if let Some((block, packed)) = block {
                let sum = gathered.bank.lengths().plus(packed.lengths());
                if !self.fits(sum, self.limits.bank_bytes) {
                    if !gathered.blocks.is_empty() {
                        self.waiting.push_front(Waiting { id, detail, block: Some((block, packed)) });
                        break;
                    }
                    self.split(id, detail, &block)?;
                    let (id, detail, piece) = self.pieces.pop_front().expect("a block has a piece");
                    return Ok(Some(self.piece(id, detail, &piece)));
                }
                gathered.bank.push(packed);
            }
            gathered.blocks.push(arrived);
        }
        Ok((!gathered.blocks.is_empty()).then_some(gathered))
    }

    /// Takes what is at hand up to the first block that is not, or reads as many as there are threads; packs them.
    fn read(&mut self) -> Result<()> {
        let count = rayon::current_num_threads().min(self.wanted.len());
        let mut read = Vec::with_capacity(count);
        while let Some(&(id, detail)) = self.wanted.front()
            && read.len() < count
            && let Some(held) = self.host.at_hand(id, detail)
        {
            read.push((id, held));
            self.wanted.pop_front();
        }
        if read.is_empty() {
            let batch: Vec<(BlockId, Detail)> = self.wanted.drain(..count).collect();
            let fetched = batch.into_par_iter().map(|(id, detail)| Ok((id, self.host.fetch(id, detail)?)));
            read = fetched.collect::<Result<Vec<_>>>()?;
        }
        let pack = |(id, held): (BlockId, Arc<HeldBlock>)| {
            let block = held.block.as_ref().map(|block| (Arc::clone(block), Packed::new(id, block, self.firsts)));
            Waiting { id, detail: held.detail, block }
        };
        let entries = |held: &HeldBlock| held.block.as_ref().map_or(0, |block| block.sparse.rows.len());
        match read.iter().map(|(_, held)| entries(held)).sum::<usize>() {
            ..FEW_ENTRIES => self.waiting.extend(read.into_iter().map(pack)),
            FEW_ENTRIES.. => self.waiting.extend(read.into_par_iter().map(pack).collect::<Vec<_>>()),
        }
        Ok(())
    }

    fn fits(&self, lengths: Lengths, bank_bytes: u64) -> bool {
        lengths.largest_bytes() <= self.limits.binding_bytes && lengths.bytes() <= bank_bytes
    }

    /// Splits a block by components into as few pieces as fit a bank each. Where not even one component does, a piece may
    /// take all of the memory.
    fn split(&mut self, id: BlockId, detail: Detail, block: &CompactBlock) -> Result<()> {
        let rank = block.rank() as u32;
        let lengths = |components: Range<u32>| Lengths::of_piece(block, &components);
        let mut first = 0;
        loop {
            let mut end = rank.min(first + 1);
            while end < rank && self.fits(lengths(first..end + 1), self.limits.bank_bytes) {
                end += 1;
            }
            let needed = lengths(first..end);
            if !self.fits(needed, self.limits.most_bytes) {
                let (largest, binding_bytes) = (needed.largest_bytes(), self.limits.binding_bytes);
                return Err(match largest > binding_bytes {
                    true => too_large(&id.to_string(), largest, binding_bytes),
                    false => too_large(&id.to_string(), needed.bytes(), self.limits.most_bytes),
                });
            }
            self.pieces.push_back((id, detail, Arc::new(block.piece(first..end))));
            first = end;
            if first == rank {
                return Ok(());
            }
        }
    }

    fn piece(&self, id: BlockId, detail: Detail, piece: &Arc<CompactBlock>) -> PackedBanks {
        let mut bank = Bank::default();
        bank.push(Packed::new(id, piece, self.firsts));
        let blocks = vec![Arrived { id, detail, is_hole: false }];
        PackedBanks { bank, blocks, is_piece: true }
    }
}
