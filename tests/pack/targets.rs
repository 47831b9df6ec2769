//! What is asked for and what it costs.

use ltm::compress::{CompressSettings, Target};
use ltm::pipeline::{PackOptions, PackReport};

use super::{pack, render};

/// Whatever the target, its cap on the rank, and the samples' noise: more bytes are a nearer image.
#[test]
fn more_bytes_are_never_spent_without_a_smaller_error() {
    let folder = tempfile::tempdir().unwrap();
    let (_, matrix) = render(&folder, "mixed");
    let path = folder.path().join("packed.ltc");
    for (denoise, rank) in [(true, 3), (true, 64), (false, 4), (false, 24)] {
        let packed = |target: Target| -> PackReport {
            let compress = CompressSettings { target, rank, ..CompressSettings::default() };
            let mut options = PackOptions { denoise, compress, allow_lost_lights: true, ..PackOptions::default() };
            options.container.overwrite = true;
            pack(&matrix, &path, &options)
        };
        let targets = [30.0, 42.0, 54.0, 66.0, 78.0, 90.0].map(Target::PsnrDb);
        for targets in [targets, [0.3, 0.1, 0.03, 0.01, 3e-3, 1e-3].map(Target::RelativeL2)] {
            let reports = targets.map(packed);
            for (pair, targets) in reports.windows(2).zip(targets.windows(2)) {
                let bytes = pair[1].packed_bytes as f64 / pair[0].packed_bytes as f64;
                // That of images under the prior, which is what a target is about.
                let error = f64::from(pair[1].lights.prior) / f64::from(pair[0].lights.prior);
                let case = format!("denoise {denoise}, rank {rank}, {targets:?}: {bytes} × bytes, {error} × error");
                assert!(bytes < 1.03 || error < 0.97, "{case}");
                // Nor do bytes grow faster than squared errors fall, as they do where what is lost anyway is refined.
                assert!(bytes < 1.03 / error.powi(2), "{case}");
            }
        }
    }
}
