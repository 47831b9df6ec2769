//! Figures 7 and 8 of the paper: images of the full matrix and of the packed one, side by side, with their error.

use super::StudyReport;
use super::bench::{Bench, Wanted};
use super::fig9::METRIC_NOTE;
use super::measured::Measured;
use super::mosaic::Picture;
use super::rivals::product;
use super::table::Table;
use ltm::compress::CompressSettings;
use ltm::error::Result;
use ltm::light::evaluation_lightings;
use ltm::matrix::BlockSource;
use ltm::relight::relight_raw;

/// The lightings that are shown.
const SHOWN: [&str; 3] = ["all on", "two soft spots", "narrow spot"];

pub(super) fn run(bench: &Bench<'_>) -> Result<StudyReport> {
    let (scenes, size, texels, samples, scale): (&[&'static str], _, _, _, _) = match bench.quick {
        true => (&["diffuse"], (48, 36), 8, 64, 4),
        false => (&["diffuse", "reflections", "caustics", "mixed"], (192, 144), 32, 512, 2),
    };
    let scenes = bench.with_conference(scenes);
    let mut table = Table::new(
        "The full matrix and the packed one, side by side",
        bench.notes(&[METRIC_NOTE, "Packed as `ltm-pack` does it by itself; errors for single lightings."]),
        &[
            ("scene", 0),
            ("lighting", 0),
            ("rows", 0),
            ("columns", 0),
            ("block_px", 0),
            ("samples_per_px", 0),
            ("mean_rank", 2),
            ("bytes", 0),
            ("ratio", 0),
            ("psnr_lin_db", 2),
            ("psnr_clip_db", 2),
            ("relative_l2", 4),
            ("rel_mse", 5),
            ("flip", 4),
        ],
    );
    let mut report = StudyReport::default();
    bench.watch.begin("fig7", scenes.len() as u64, "files");
    for (index, &scene) in scenes.iter().enumerate() {
        let matrix = bench.matrix(Wanted { scene, size, texels, samples, seed: 0, block_side: 32 })?;
        let lightings = evaluation_lightings(&matrix.job().basis, super::reference::LIGHTINGS_SEED);
        let shown: Vec<_> = lightings.into_iter().filter(|l| SHOWN.contains(&l.0)).collect();
        let (names, weights): (Vec<_>, Vec<_>) = shown.into_iter().unzip();
        let references = relight_raw(&matrix, &weights)?;
        let packed = product(bench, &matrix, &CompressSettings::default(), &weights)?;
        let ratio = matrix.shape().raw_bytes() as f64 / packed.bytes as f64;
        let mut rows: [Vec<Picture>; 3] = Default::default();
        for ((name, image), reference) in names.into_iter().zip(&packed.images).zip(&references) {
            let error = Measured::of(image, reference);
            table.push(vec![
                scene.into(),
                name.into(),
                matrix.shape().rows().into(),
                matrix.shape().columns().into(),
                matrix.shape().block_side().into(),
                samples.into(),
                packed.rank.into(),
                packed.bytes.into(),
                ratio.into(),
                error.psnr_linear.into(),
                error.psnr_clipped.into(),
                error.relative_l2.into(),
                error.rel_mse.into(),
                error.flip.into(),
            ]);
            rows[0].push(Picture::shown(reference, reference, format!("{scene}, {name}: full matrix")));
            rows[1].push(Picture::shown(image, reference, format!("packed {ratio:.0}:1")));
            let caption =
                format!("FLIP {:.3}, lin {:.1}, clip {:.1} dB", error.flip, error.psnr_linear, error.psnr_clipped);
            rows[2].push(Picture::error(image, reference, caption));
        }
        let figure = if index < 2 { "fig7" } else { "fig8" };
        report.add_pictures(&bench.out, &format!("{figure}-{scene}"), &rows, scale)?;
        bench.watch.advance(1, packed.bytes, "B");
    }
    bench.watch.end();
    report.add_table(&bench.out, "fig7-8", &table)?;
    Ok(report)
}
