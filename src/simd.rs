//! Loops that are compiled once more for the widest vectors that the machine has.

/// Runs `work`, a closure with `#[inline(always)]`, compiled for the machine's widest vectors. Its loops may do what the order of
/// adding allows: the bits are the same on every machine.
///
/// A closure that is handed to [`pulp::Arch::dispatch`] itself is called through `FnOnce::call_once`, a shim of the compiler without
/// that attribute: if the closure is long the shim stays a function of its own, for the oldest machines. `FnMut::call_mut` has no
/// shim.
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
