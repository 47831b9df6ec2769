//! What the worker was asked for, and what of it has come.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::display::Display;
use crate::mixer::Mix;
use crate::reach::TexelReach;
use crate::worker::Picture;
use ltm::light::Lighting;

use super::shown_picture::Latency;

/// How a picture was to be shown.
#[derive(Clone, Copy, PartialEq)]
pub(super) struct RequestedDisplay {
    pub(super) display: Display,
    /// The snapshot that it was compared with.
    pub(super) snapshot: Option<usize>,
    /// Address of that one's image.
    pub(super) image: Option<usize>,
}

pub(super) struct Requests {
    /// The newest lighting, and the mix that it was made of.
    pub(super) lighting: Arc<Lighting>,
    pub(super) lit: Option<Mix>,
    /// What each column brings to the picture, once that is known.
    pub(super) reach: Option<TexelReach>,
    /// The newest display.
    pub(super) display: Option<RequestedDisplay>,
    /// Generations of the newest request, and of the newest that changed the lighting.
    pub(super) generation: u64,
    pub(super) relit: u64,
    /// Frame in which each open request was made.
    pending: BTreeMap<u64, u64>,
}

impl Requests {
    pub(super) fn new(lighting: Arc<Lighting>) -> Self {
        Self { lighting, lit: None, reach: None, display: None, generation: 0, relit: 0, pending: BTreeMap::new() }
    }

    /// Forgets what was asked for: nothing of it will come, and all is to be asked for again.
    pub(super) fn begin_anew(&mut self) {
        (self.lit, self.display) = (None, None);
        self.pending.clear();
    }

    /// Counts a request, made in this frame; `relit` where it has another lighting.
    pub(super) fn count(&mut self, frame: u64, relit: bool) {
        self.generation += 1;
        if relit {
            self.relit = self.generation;
        }
        self.pending.insert(self.generation, frame);
    }

    /// Takes note of a picture; what it cost, if it was relit for a request.
    pub(super) fn answered(&mut self, picture: &Picture, frame: u64) -> Option<Latency> {
        let asked_in = self.pending.get(&picture.generation).copied();
        self.pending.retain(|&generation, _| generation > picture.generation);
        let (relight_secs, total_secs) = (picture.relight_secs, picture.total_secs);
        let frames = frame - asked_in.filter(|_| relight_secs > 0.0)?;
        Some(Latency { frames, relight_secs, total_secs })
    }

    /// Whether all requests were answered.
    pub(super) fn are_answered(&self) -> bool {
        self.pending.is_empty()
    }
}
