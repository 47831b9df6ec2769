//! Stand-in for [`OnGpu`] in a build without the feature `gpu`: opening it is an error.

use std::convert::Infallible;
use std::marker::PhantomData;

use super::RelightOptions;
use crate::container::ContainerReader;
use crate::error::{Error, Result};
use crate::image::LinearImage;
use crate::light::Lighting;
use crate::relight::PagedRelighter;

/// A relighter on a GPU, of which there is none.
pub(super) struct OnGpu<'a>(Infallible, PhantomData<&'a ()>);

impl<'a> OnGpu<'a> {
    pub(super) fn open(_: &'a ContainerReader, _: &RelightOptions, _: &dyn Fn() -> PagedRelighter<'a>) -> Result<Self> {
        Err(Error::NoGpu("this build is without the feature `gpu`".into()))
    }

    pub(super) fn relight(&self, _: &Lighting) -> Result<LinearImage> {
        match self.0 {}
    }

    pub(super) fn adapter(&self) -> String {
        match self.0 {}
    }

    pub(super) fn is_software(&self) -> bool {
        match self.0 {}
    }

    pub(super) fn description(&self) -> String {
        match self.0 {}
    }

    pub(super) fn damage(&self) -> Vec<String> {
        match self.0 {}
    }

    pub(super) fn host(&self) -> Option<&PagedRelighter<'a>> {
        match self.0 {}
    }
}
