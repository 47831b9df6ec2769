//! Figure 5 of the paper: what a nonlinear map does to noise and to sharp light, beside the linear methods, as pictures.

use super::StudyReport;
use super::bench::{Bench, Wanted};
use super::fig9::{ALGORITHM4, METRIC_NOTE, OURS};
use super::measured::Measured;
use super::mosaic::Picture;
use super::rivals::{kernel, product};
use super::table::Table;
use ltm::compress::{CompressSettings, Method, Target};
use ltm::error::Result;
use ltm::light::evaluation_lightings;
use ltm::matrix::BlockSource;
use ltm::relight::relight_raw;

/// The lighting that is shown.
const SHOWN: &str = "two soft spots";

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let (scenes, size, texels, samples, rank, scale): (&[&'static str], _, _, _, _, _) = match bench.quick {
        true => (&["mixed"], (48, 36), 8, 16, 6, 4),
        false => (&["reflections", "caustics", "mixed"], (192, 144), 32, 64, 16, 2),
    };
    let note = format!(
        "Lighting: {SHOWN}. Kernel Nyström and Algorithm 4 keep {rank} columns of each block; ours is asked for the bytes of \
kernel Nyström. Errors against the raw matrix, for this one lighting."
    );
    let mut table = Table::new(
        "The nonlinear map beside linear methods",
        bench.notes(&[METRIC_NOTE, &note]),
        &[
            ("scene", 0),
            ("method", 0),
            ("rows", 0),
            ("columns", 0),
            ("block_px", 0),
            ("samples_per_px", 0),
            ("mean_rank", 2),
            ("bytes", 0),
            ("psnr_lin_db", 2),
            ("psnr_clip_db", 2),
            ("relative_l2", 4),
            ("flip", 4),
        ],
    );
    let mut rows = Vec::new();
    bench.watch.begin("fig5", 3 * scenes.len() as u64, "files");
    for &scene in scenes {
        let matrix = bench.matrix(Wanted { scene, size, texels, samples, seed: 0, block_side: 32 })?;
        let lightings = evaluation_lightings(&matrix.job().basis, super::reference::LIGHTINGS_SEED);
        let shown: Vec<_> = lightings.into_iter().filter(|l| l.0 == SHOWN).map(|l| l.1).collect();
        let reference = &relight_raw(&matrix, &shown)?[0];
        let nonlinear = kernel(bench, &matrix, rank, &shown)?;
        let algorithm4 = CompressSettings { rank, ..CompressSettings::of_method(Method::Algorithm4) };
        let ours = CompressSettings { target: Target::Bytes(nonlinear.bytes), ..CompressSettings::default() };
        let all = [
            ("kernel Nyström", nonlinear),
            (ALGORITHM4, product(bench, &matrix, &algorithm4, &shown)?),
            (OURS, product(bench, &matrix, &ours, &shown)?),
        ];
        let mut pictures = vec![Picture::shown(reference, reference, format!("{scene}: matrix, {samples} spp"))];
        let mut errors = vec![Picture::error(reference, reference, "error: none")];
        for (method, packed) in &all {
            let (image, error) = (&packed.images[0], Measured::of(&packed.images[0], reference));
            table.push(vec![
                scene.into(),
                (*method).into(),
                matrix.shape().rows().into(),
                matrix.shape().columns().into(),
                matrix.shape().block_side().into(),
                samples.into(),
                packed.rank.into(),
                packed.bytes.into(),
                error.psnr_linear.into(),
                error.psnr_clipped.into(),
                error.relative_l2.into(),
                error.flip.into(),
            ]);
            pictures.push(Picture::shown(image, reference, format!("{method}, {} kB", packed.bytes / 1000)));
            errors.push(Picture::error(
                image,
                reference,
                format!("FLIP {:.3}, clip {:.1} dB", error.flip, error.psnr_clipped),
            ));
            bench.watch.advance(1, packed.bytes, "B");
        }
        rows.extend([pictures, errors]);
    }
    bench.watch.end();
    let mut report = StudyReport::default();
    report.add_table(&bench.out, "fig5", &table)?;
    report.add_pictures(&bench.out, "fig5", &rows, scale)?;
    Ok(report)
}
