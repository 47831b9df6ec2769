//! Relighting on the GPU a matrix whose factors do not fit into its memory.

use std::collections::HashSet;
use std::collections::hash_map::{Entry, HashMap};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rayon::prelude::*;

use super::device::Gpu;
use super::gather::{Arrived, BankPacker, Limits, PackedBanks};
use super::resident::{ResidentBank, SharedArrays, read_back, submit};
use super::{GpuSettings, binding_limit, too_large};
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::matrix::{BlockId, CHANNELS, MatrixShape};
use crate::relight::cpu::{check_columns, check_size};
use crate::relight::paged::PagedRelighter;
use crate::relight::pager::{Admission, Detail, Pager, plan};
use crate::relight::tiles::for_each_tile;

/// One over the share of the budget that a bank takes. Two banks are in flight while the others stay. Tuned: decision
/// 40.
const BANK_SHARE: u64 = 6;
const PASSING: u64 = 2;
/// Largest number of bytes of a bank. Larger ones stream no faster, and take room from those that stay.
const MAX_BANK_BYTES: u64 = 64 << 20;

/// Relights on the GPU within a budget of its memory: banks of blocks stay there as far as the budget goes, the others
/// pass through, bank by bank. Blocks come through a [`PagedRelighter`], so that host memory has its own budget. Beside the
/// budget stand 24 MiB of memory that both see, through which banks are sent.
///
/// A block that is larger than a bank may be passes through in pieces, which are added up on the host.
pub struct PagedGpuRelighter<'a> {
    gpu: Gpu,
    host: PagedRelighter<'a>,
    shared: SharedArrays,
    limits: Limits,
    state: Mutex<State>,
}

/// A bank in GPU memory, by the order in which banks came.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct BankId(u64);

/// Position of a block in GPU memory.
#[derive(Clone, Copy, Debug)]
struct BankSlot {
    detail: Detail,
    /// None for a block of which nothing can be read.
    bank: Option<BankId>,
}

/// A bank that stays.
struct KeptBank {
    bank: Arc<ResidentBank>,
    /// How many of its blocks have not come anew in another bank.
    standing: usize,
}

struct State {
    pager: Pager<BankId>,
    banks: HashMap<BankId, KeptBank>,
    places: HashMap<BlockId, BankSlot>,
    uploads: u64,
    uploaded_bytes: u64,
    peak_bytes: u64,
}

/// A bank that was put into GPU memory.
struct Uploaded {
    bank: Arc<ResidentBank>,
    /// Whether it stays; else it goes when it was used.
    is_kept: bool,
    submission: wgpu::SubmissionIndex,
}

/// The action once a bank is in GPU memory.
#[derive(Clone, Copy)]
enum Then {
    /// None: a later call uses it.
    Nothing,
    /// It is relit, and the image is read back.
    Relight,
}

/// The image as far as it has come back, block by block.
struct Canvas {
    shape: MatrixShape,
    blocks: HashMap<BlockId, Vec<[f32; CHANNELS]>>,
}

impl<'a> PagedGpuRelighter<'a> {
    /// A relighter that takes at most `budget_bytes` of GPU memory. Uploads nothing yet.
    ///
    /// # Errors
    /// [`Error::NoGpu`] without a loader or an adapter; a lighting that does not fit.
    pub fn new(host: PagedRelighter<'a>, budget_bytes: u64, settings: GpuSettings) -> Result<Self> {
        Self::on(Gpu::open(settings.subgroups)?, host, budget_bytes, settings)
    }

    /// As [`new`](Self::new), on a device that is open already. What the device reports outside calls of this type goes
    /// to the handler that its owner has set.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn on_device(
        device: wgpu::Device,
        queue: wgpu::Queue,
        host: PagedRelighter<'a>,
        budget_bytes: u64,
        settings: GpuSettings,
    ) -> Result<Self> {
        Self::on(Gpu::on_device(device, queue, settings.subgroups)?, host, budget_bytes, settings)
    }

    fn on(gpu: Gpu, host: PagedRelighter<'a>, budget_bytes: u64, settings: GpuSettings) -> Result<Self> {
        let transform = host.column_transform();
        let binding_bytes = binding_limit(&gpu, transform, settings)?;
        let lighting_bytes = SharedArrays::lighting_bytes(transform);
        let Some(most_bytes) = budget_bytes.checked_sub(lighting_bytes) else {
            return Err(too_large("the lighting", lighting_bytes, budget_bytes));
        };
        let bank_bytes = (most_bytes / BANK_SHARE).min(MAX_BANK_BYTES);
        let state = State {
            pager: Pager::new(most_bytes - PASSING * bank_bytes),
            banks: HashMap::new(),
            places: HashMap::new(),
            uploads: 0,
            uploaded_bytes: 0,
            peak_bytes: lighting_bytes,
        };
        let shared = SharedArrays::new(&gpu, transform, host.column_scales());
        let limits = Limits { binding_bytes, bank_bytes, most_bytes };
        Ok(Self { gpu, host, shared, limits, state: Mutex::new(state) })
    }

    /// The image under `lighting`: every block with all its layers.
    ///
    /// # Errors
    /// As [`relight_view`](Self::relight_view).
    pub fn relight(&self, lighting: &Lighting) -> Result<LinearImage> {
        let shape = self.host.shape();
        let mut image = LinearImage::black(shape.width(), shape.height());
        let all: Vec<BlockId> = shape.blocks().collect();
        self.relight_view(lighting, &all, Detail::Whole, &mut image)?;
        Ok(image)
    }

    /// Computes the pixels of the blocks in view. Missing ones are read in this order, and stay in memory as far as the
    /// budgets allow. `detail` as in [`PagedRelighter::relight_view`]. One call runs at a time; others wait.
    ///
    /// # Errors
    /// A lighting with another number of columns than the matrix, an image of another size; what the source
    /// reports other than damage; a block one component of which does not fit the budget or one binding;
    /// [`Error::NoGpu`] where the device fails.
    pub fn relight_view(
        &self,
        lighting: &Lighting,
        view: &[BlockId],
        detail: Detail,
        image: &mut LinearImage,
    ) -> Result<()> {
        let shape = self.host.shape();
        check_columns(shape, lighting)?;
        check_size(shape, image)?;
        let mut state = self.lock();
        self.shared.set(&self.gpu, lighting);
        let mut seen = HashSet::new();
        let missing: Vec<BlockId> = view
            .iter()
            .copied()
            .filter(|&id| seen.insert(id) && state.detail(id).is_none_or(|at_hand| at_hand < detail))
            .collect();
        // What comes anew in more detail makes room first.
        missing.iter().for_each(|id| state.forget(*id));
        self.look_at(&mut state, &seen, view);
        let mut canvas = Canvas { shape, blocks: HashMap::new() };
        let shown: Vec<BankId> = state.banks_of(&seen).collect();
        let submission = submit(&self.gpu, &shown.iter().map(|bank| &*state.banks[bank].bank).collect::<Vec<_>>());
        let mut gather =
            BankPacker::new(self.shared.firsts(), &self.host, missing.into_iter().map(|id| (id, detail)), self.limits);
        // While the GPU computes, the next bank is read and packed.
        let mut next = gather.next();
        self.gpu.wait_for(submission)?;
        for id in shown {
            // A bank may hold blocks that have come anew in another.
            let stands = |block| state.places.get(&block).is_some_and(|place| place.bank == Some(id));
            let bank = &state.banks[&id].bank;
            read_back(&self.gpu, &[bank], |images| canvas.take(bank, images[0], &stands))?;
        }
        let state = &mut *state;
        let mut passing: Option<Uploaded> = None;
        while let Some(gathered) = next? {
            let is_large = |bytes: u64| bytes > self.limits.bank_bytes;
            // One that is larger than its share has the memory to itself.
            if is_large(gathered.bank.lengths().bytes()) || passing.as_ref().is_some_and(|one| is_large(one.bank.bytes))
            {
                self.finish(passing.take(), &mut canvas)?;
            }
            let passing_bytes = passing.as_ref().filter(|bank| !bank.is_kept).map_or(0, |passing| passing.bank.bytes);
            // While one bank is sent, the one before is relit and read back, and the next is read and packed.
            let (uploaded, ahead) = rayon::join(
                || self.upload(state, &gathered, Then::Relight, passing_bytes),
                || self.finish(passing.take(), &mut canvas).and_then(|()| gather.next()),
            );
            (passing, next) = (uploaded?, ahead);
        }
        self.finish(passing, &mut canvas)?;
        for_each_tile(image, shape, |mut tile| {
            if seen.contains(&tile.id) {
                match canvas.blocks.get(&tile.id) {
                    Some(pixels) => tile.copy(pixels),
                    None => tile.mark_as_hole(),
                }
            }
            Ok::<_, Error>(())
        })
    }

    /// Waits for a bank that is relit, and takes its image.
    fn finish(&self, uploaded: Option<Uploaded>, canvas: &mut Canvas) -> Result<()> {
        let Some(Uploaded { bank, submission, .. }) = uploaded else { return Ok(()) };
        self.gpu.wait_for(submission)?;
        read_back(&self.gpu, &[&bank], |images| canvas.take(&bank, images[0], &|_| true))
    }

    /// Uploads what the view lacks and then what lies nearby, base layers before the rest, until the budget is full.
    /// Evicts nothing that is in view.
    ///
    /// # Errors
    /// As [`relight_view`](Self::relight_view).
    pub fn prefetch(&self, view: &[BlockId], nearby: &[BlockId]) -> Result<()> {
        let mut state = self.lock();
        let seen = view.iter().copied().collect();
        self.look_at(&mut state, &seen, view);
        let mut steps = plan(view, nearby, |id| state.detail(id)).into_iter().peekable();
        while let Some(&(_, detail)) = steps.peek() {
            // Banks of one detail, so that the order of the plan is kept.
            let step = std::iter::from_fn(|| steps.next_if(|(_, next)| *next == detail));
            let mut gather = BankPacker::new(self.shared.firsts(), &self.host, step, self.limits);
            while let Some(gathered) = gather.next()? {
                // What comes in pieces never stays.
                if gathered.is_piece {
                    continue;
                }
                if self.upload(&mut state, &gathered, Then::Nothing, 0)?.is_some_and(|uploaded| !uploaded.is_kept) {
                    return Ok(());
                }
            }
        }
        // What lies nearby gives way to what will be seen.
        self.look_at(&mut state, &seen, view);
        Ok(())
    }

    /// Says to both pagers what is in view.
    fn look_at(&self, state: &mut State, seen: &HashSet<BlockId>, view: &[BlockId]) {
        self.host.set_view(view);
        let banks: Vec<BankId> = state.banks_of(seen).collect();
        for bank in &banks {
            state.pager.touch(*bank);
        }
        state.pager.set_view(banks);
    }

    /// Makes room for a bank beside what passes through, and puts it into GPU memory; none where it has no blocks.
    fn upload(
        &self,
        state: &mut State,
        gathered: &PackedBanks,
        then: Then,
        passing_bytes: u64,
    ) -> Result<Option<Uploaded>> {
        let PackedBanks { bank, blocks, is_piece } = gathered;
        for Arrived { id, detail, .. } in blocks.iter().filter(|block| block.is_hole) {
            state.place(*id, BankSlot { detail: *detail, bank: None });
        }
        if bank.blocks.is_empty() {
            return Ok(None);
        }
        let bytes = bank.lengths().bytes();
        let id = BankId(state.uploads);
        let least = blocks.iter().map(|block| block.detail).min().unwrap_or(Detail::Whole);
        let admission = match is_piece {
            true => Admission { kept: false, evicted: Vec::new() },
            false => state.pager.admit(id, least, bytes),
        };
        let mut evicted = admission.evicted;
        if !admission.kept {
            evicted.extend(state.pager.shrink_to(self.limits.most_bytes - bytes - passing_bytes));
        }
        evicted.iter().for_each(|bank| state.drop_bank(*bank));
        let resident = match then {
            Then::Nothing => ResidentBank::upload(&self.gpu, &self.shared, bank, |_, _| ()),
            Then::Relight => ResidentBank::upload_and_relight(&self.gpu, &self.shared, bank),
        };
        let (resident, submission) = match resident {
            Ok(resident) => resident,
            Err(error) => {
                state.pager.remove(id);
                return Err(error);
            }
        };
        state.uploads += 1;
        state.uploaded_bytes += resident.sent_bytes;
        let passing = passing_bytes + if admission.kept { 0 } else { resident.bytes };
        let used = state.pager.used_bytes() + passing + self.shared.bytes();
        state.peak_bytes = state.peak_bytes.max(used);
        let bank = Arc::new(resident);
        if admission.kept {
            state.pager.see(id);
            state.banks.insert(id, KeptBank { standing: bank.places.len(), bank: Arc::clone(&bank) });
            for Arrived { id: block, detail, .. } in blocks.iter().filter(|block| !block.is_hole) {
                state.place(*block, BankSlot { detail: *detail, bank: Some(id) });
            }
        }
        Ok(Some(Uploaded { bank, is_kept: admission.kept, submission }))
    }

    /// Name of the adapter and its driver's interface.
    pub fn adapter(&self) -> String {
        self.gpu.name()
    }

    /// Whether the adapter is a software one (llvmpipe, WARP), slower than the CPU path.
    pub fn is_software(&self) -> bool {
        self.gpu.is_software()
    }

    /// The blocks' way through host memory: what was read, and what was damaged.
    pub fn host(&self) -> &PagedRelighter<'a> {
        &self.host
    }

    /// Banks uploaded so far.
    pub fn uploads(&self) -> u64 {
        self.lock().uploads
    }

    /// Bytes sent to the GPU so far for the banks uploaded; what the kernels make there is not among them.
    pub fn uploaded_bytes(&self) -> u64 {
        self.lock().uploaded_bytes
    }

    /// Bytes of GPU memory that what stays there takes, images included.
    pub fn resident_bytes(&self) -> u64 {
        self.lock().pager.used_bytes() + self.shared.bytes()
    }

    /// Most bytes of GPU memory that buffers took at once.
    pub fn peak_bytes(&self) -> u64 {
        self.lock().peak_bytes
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    /// The detail of a block that is in memory.
    fn detail(&self, id: BlockId) -> Option<Detail> {
        self.places.get(&id).map(|place| place.detail)
    }

    /// The banks that hold blocks of a view, in the order in which they came.
    fn banks_of(&self, seen: &HashSet<BlockId>) -> impl Iterator<Item = BankId> + use<> {
        let banks = seen.iter().filter_map(|id| self.places.get(id)?.bank);
        let mut banks: Vec<BankId> = banks.collect::<HashSet<_>>().into_iter().collect();
        banks.sort_unstable_by_key(|bank| bank.0);
        banks.into_iter()
    }

    fn place(&mut self, id: BlockId, place: BankSlot) {
        self.forget(id);
        self.places.insert(id, place);
    }

    /// Takes a block out of what is at hand, and its bank too where no other block needs it.
    fn forget(&mut self, id: BlockId) {
        let Some(BankSlot { bank: Some(bank), .. }) = self.places.remove(&id) else { return };
        let Some(kept) = self.banks.get_mut(&bank) else { return };
        kept.standing -= 1;
        if kept.standing == 0 {
            self.pager.remove(bank);
            self.banks.remove(&bank);
        }
    }

    /// Takes a bank out that the pager has evicted.
    fn drop_bank(&mut self, id: BankId) {
        for (block, _) in self.banks.remove(&id).iter().flat_map(|kept| &kept.bank.places) {
            if self.places.get(block).is_some_and(|place| place.bank == Some(id)) {
                self.places.remove(block);
            }
        }
    }
}

impl Canvas {
    /// Takes the image of the blocks of a bank that count. What comes a second time is another piece of the same block.
    fn take(
        &mut self,
        bank: &ResidentBank,
        image: &[[f32; CHANNELS]],
        counts: &(dyn Fn(BlockId) -> bool + Sync),
    ) -> Result<()> {
        let counted = bank.places.par_iter().filter(|(id, _)| counts(*id));
        let copied = counted.map(|&(id, first)| {
            let pixels = &image[first as usize..][..self.shape.rect(id).rows() / CHANNELS];
            (id, pixels.to_vec())
        });
        for (id, pixels) in copied.collect::<Vec<_>>() {
            match self.blocks.entry(id) {
                Entry::Vacant(place) => drop(place.insert(pixels)),
                Entry::Occupied(mut sums) => {
                    for (sum, part) in sums.get_mut().iter_mut().flatten().zip(pixels.iter().flatten()) {
                        *sum += part;
                    }
                }
            }
        }
        Ok(())
    }
}
