//! Loops that are compiled once more for the widest vectors that the machine has.

/// Runs `work`, a closure with `#[inline(always)]`, compiled for the widest vectors of the processor. Loops are
/// vectorised only as far as the order of additions allows, so the bits are the same on every machine.
///
/// A closure passed to [`pulp::Arch::dispatch`] directly is called through `FnOnce::call_once`, a compiler shim without
/// that attribute. For a long closure the shim stays a function of its own, compiled for the baseline instruction set.
/// `FnMut::call_mut` has no shim.
#[inline(always)]
pub(crate) fn dispatch<R>(work: impl FnMut() -> R) -> R {
    pulp::Arch::new().dispatch(OnWidest(work))
}

struct OnWidest<F>(F);

impl<R, F: FnMut() -> R> pulp::WithSimd for OnWidest<F> {
    type Output = R;

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(mut self, _: S) -> R {
        (self.0)()
    }
}
