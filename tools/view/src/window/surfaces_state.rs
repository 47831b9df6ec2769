//! What is known of the surfaces in view, of which the light meter and the view of features speak.

use std::sync::Arc;

use super::message::line;
use crate::surfaces::Surfaces;
use crate::worker::{Brought, Session};

/// What is known of the surfaces.
#[derive(Default)]
pub(super) enum SurfacesState {
    /// Nobody has asked yet.
    #[default]
    Unasked,
    /// They are being read.
    Reading,
    /// They are known.
    Known(Arc<Surfaces>),
    /// They are not, and why.
    Unknown(String),
}

impl SurfacesState {
    /// Has the surfaces read, unless they were already.
    pub(super) fn ask(&mut self, session: &Session) {
        if !matches!(self, Self::Unasked) {
            return;
        }
        *self = Self::Reading;
        let (path, container) = (session.path.clone(), session.container.clone());
        session.worker.beside(move || {
            let surfaces = Surfaces::beside(&path, &container).map_err(|error| line(&error));
            Ok(Brought::Surfaces(surfaces.map(Arc::new)))
        });
    }

    /// Takes what was read.
    pub(super) fn take(&mut self, surfaces: Result<Arc<Surfaces>, String>) {
        *self = surfaces.map_or_else(Self::Unknown, Self::Known);
    }

    /// The surfaces, where they are known.
    pub(super) fn known(&self) -> Option<&Arc<Surfaces>> {
        if let Self::Known(surfaces) = self { Some(surfaces) } else { None }
    }

    pub(super) fn is_reading(&self) -> bool {
        matches!(self, Self::Reading)
    }
}
