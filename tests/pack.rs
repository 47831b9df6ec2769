//! Packing: stored and fused give the same bytes, a stopped pack goes on, memory and disk are kept, and the stated error
//! is the real one.

#[path = "pack/dark_lights.rs"]
mod dark_lights;
#[path = "pack/divided.rs"]
mod divided;
#[path = "pack/targets.rs"]
mod targets;

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use ltm::compress::{CompressSettings, Method, Scope, Target};
use ltm::container::ContainerReader;
use ltm::image::{LightSet, LinearImage, compare, write_exr_layers};
use ltm::light::{Clusters, Light, LightBasis, LightKind, Lighting, evaluation_lightings};
use ltm::matrix::{BlockSource, FactorSource, TracedBlock};
use ltm::pipeline::{self, PackOptions, RelightOptions, RenderOptions};
use ltm::relight::relight_raw;
use ltm::resources::{NoProgress, Progress};
use ltm::scene::{BuiltIn, LoadedScene};
use ltm::store::StoreReader;
use ltm::{Error, MemoryMatrix};
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64Mcg;
use tempfile::TempDir;

/// A small room with blocks at both edges that are not full.
fn room(name: &str) -> LoadedScene {
    let mut loaded = BuiltIn { width: 72, height: 40, texels: 8 }.named(name).unwrap();
    loaded.settings.samples_per_pixel = 4;
    loaded
}

fn render(folder: &TempDir, name: &str) -> (PathBuf, StoreReader) {
    let path = folder.path().join(format!("{name}.ltm"));
    pipeline::render(room(name), &path, &RenderOptions::default(), &NoProgress).unwrap();
    (path.clone(), StoreReader::open(&path).unwrap())
}

fn pack(matrix: &StoreReader, path: &Path, options: &PackOptions) -> pipeline::PackReport {
    pipeline::pack(matrix, matrix.job(), path, options, &NoProgress).unwrap()
}

/// Asks to stop when so many steps of any stage are done.
struct StopAfter(AtomicU64);

impl Progress for StopAfter {
    fn begin(&self, _: &str, _: u64, _: &str) {}
    fn advance(&self, steps: u64, _: u64, _: &str) {
        let _ = self.0.fetch_update(Ordering::SeqCst, Ordering::SeqCst, |left| Some(left.saturating_sub(steps)));
    }
    fn end(&self) {}
    fn note(&self, _: &str) {}
    fn interrupted(&self) -> bool {
        self.0.load(Ordering::SeqCst) == 0
    }
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn the_fused_way_gives_the_bytes_of_the_stored_way() {
    for (name, denoise) in [("mixed", false), ("diffuse", false), ("mixed", true), ("diffuse", true)] {
        let options = PackOptions { denoise, ..PackOptions::default() };
        let folder = tempfile::tempdir().unwrap();
        let (stored, fused) = (folder.path().join("stored.ltc"), folder.path().join("fused.ltc"));
        let (_, matrix) = render(&folder, name);
        pack(&matrix, &stored, &options);
        let (render, _) = pipeline::render_packed(room(name), &fused, &options, &NoProgress).unwrap();
        assert_eq!((render.blocks_traced, render.blocks_kept), (6, 0));
        assert!(fs::read(&stored).unwrap() == fs::read(&fused).unwrap(), "{name}, denoise {denoise}");
        let mut expected = ["fused.ltc".to_owned(), "stored.ltc".to_owned(), format!("{name}.ltm")];
        expected.sort();
        assert_eq!(names(folder.path()), expected);
    }
}

/// The target is expected of the prior's lightings, the error of all over the white of all; these lightings are others.
#[test]
fn relit_images_have_the_psnr_that_was_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("diffuse.ltm");
    let mut loaded = room("diffuse");
    loaded.settings.samples_per_pixel = 128;
    pipeline::render(loaded, &path, &RenderOptions::default(), &NoProgress).unwrap();
    let matrix = StoreReader::open(&path).unwrap();
    let lightings: Vec<_> = evaluation_lightings(&matrix.job().basis, 5).into_iter().map(|(_, l)| l).collect();
    let raw = |lighting| pipeline::relight_matrix(&matrix, lighting, RelightOptions::default()).unwrap();
    let raw: Vec<_> = lightings.iter().map(raw).collect();
    let white_square = |image: &LinearImage| {
        let mut values = image.values().to_vec();
        values.sort_by(f32::total_cmp);
        f64::from(values[values.len() * 95 / 100]).powi(2)
    };
    let white: f64 = raw.iter().map(white_square).sum();
    let mut reached = Vec::new();
    for target in [20.0, 26.0, 32.0] {
        let path = folder.path().join(format!("{target}.ltc"));
        let compress = CompressSettings { target: Target::PsnrDb(target), noise_factor: None, ..Default::default() };
        let report = pack(&matrix, &path, &PackOptions { compress, ..PackOptions::default() });
        assert_eq!(report.short_of_target, None);
        let container = ContainerReader::open(&path).unwrap();
        let (images, _) = pipeline::relight(&container, &lightings, RelightOptions::default(), &NoProgress).unwrap();
        let pairs = images.iter().zip(&raw).flat_map(|(a, b)| a.values().iter().zip(b.values()));
        let error: f64 = pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum();
        reached.push(10.0 * (white * raw[0].values().len() as f64 / error).log10());
    }
    // Most of these lightings are smoother than those of the prior: never less than was asked for, some decibels more, and
    // as many more for each.
    for (target, reached) in [20.0, 26.0, 32.0].iter().zip(&reached) {
        assert!((*target..target + 9.0).contains(reached), "{reached} dB for {target}");
    }
    assert!(reached.windows(2).all(|pair| (4.5..7.5).contains(&(pair[1] - pair[0]))), "{reached:?} for steps of 6 dB");
}

#[test]
fn denoising_stopped_after_any_block_goes_on_and_ends_with_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, path) = (folder.path().join("whole.ltc"), folder.path().join("stopped.ltc"));
    let options = PackOptions { denoise: true, ..PackOptions::default() };
    let (render, _) = pipeline::render_packed(room("mixed"), &whole, &options, &NoProgress).unwrap();
    assert_eq!(render.blocks_kept, 0);
    // Six blocks in each of four stages, of which denoising takes all in one step.
    let mut stops = 0;
    for stop in [1, 6, 11, 12, 14, 20] {
        let watch = StopAfter(AtomicU64::new(stop));
        if let Err(error) = pipeline::render_packed(room("mixed"), &path, &options, &watch) {
            stops += 1;
            assert!(matches!(error, Error::Interrupted { .. }), "{error}");
            let (render, _) = pipeline::render_packed(room("mixed"), &path, &options, &NoProgress).unwrap();
            assert!(render.blocks_kept >= stop.min(6), "{} kept after {stop}", render.blocks_kept);
        }
        assert!(fs::read(&path).unwrap() == fs::read(&whole).unwrap(), "stopped after {stop}");
        assert_eq!(names(folder.path()), ["stopped.ltc", "whole.ltc"]);
        fs::remove_file(&path).unwrap();
    }
    assert!(stops > 2, "stopped {stops} times: a stop in a stage that all threads have begun comes too late");
}

/// A texel of the sky lights more or less than the others of its cluster: without a fit it would get their mean.
#[test]
fn every_texel_of_a_sky_keeps_its_light() {
    let folder = tempfile::tempdir().unwrap();
    let mut sky = BuiltIn { width: 72, height: 40, texels: 16 }.named("environment").unwrap();
    sky.settings.samples_per_pixel = 16;
    let raw_path = folder.path().join("sky.ltm");
    pipeline::render(sky, &raw_path, &RenderOptions::default(), &NoProgress).unwrap();
    let matrix = StoreReader::open(&raw_path).unwrap();
    let path = folder.path().join("clean.ltc");
    pack(&matrix, &path, &PackOptions { denoise: true, ..PackOptions::default() });
    let container = ContainerReader::open(&path).unwrap();
    let columns = matrix.shape().columns();
    let (mut raw, mut packed) = (vec![0.0f64; columns], vec![0.0f64; columns]);
    let mut block = TracedBlock::default();
    for id in matrix.shape().blocks() {
        matrix.read_block(id, &mut block).unwrap();
        let expanded = container.read_layers(id, 0..container.layer_count(id)).unwrap().expand();
        for (sums, entries) in [(&mut raw, block.block.entries()), (&mut packed, expanded.entries())] {
            let rows = expanded.rows();
            for (sum, column) in sums.iter_mut().zip(entries.chunks_exact(rows)) {
                *sum += column.iter().map(|&v| f64::from(v)).sum::<f64>();
            }
        }
    }
    let basis = &matrix.job().basis;
    let clusters = Clusters::of_basis(basis);
    assert!(clusters.count() < columns);
    let mut of_clusters = vec![(0.0, 0.0); clusters.count()];
    for (sum, &cluster) in raw.iter().zip(clusters.of_column()) {
        let (light, count) = &mut of_clusters[usize::from(cluster)];
        *light += sum;
        *count += 1.0;
    }
    let unfitted = |column: usize| -> f64 {
        let (light, count) = of_clusters[usize::from(clusters.of_column()[column])];
        light / count
    };
    let whole: f64 = raw.iter().sum();
    let error = |of: &dyn Fn(usize) -> f64| (0..columns).map(|j| (of(j) - raw[j]).abs()).sum::<f64>() / whole;
    let (fitted, unfitted) = (error(&|j| packed[j]), error(&unfitted));
    assert!(fitted < 0.5 * unfitted, "{fitted} of the light is with the wrong texels, {unfitted} without the fit");
}

/// The shadows of single texels of a sky are no sum of what its clusters show: averaged within them, pictures are farther from the
/// truth than the samples are.
#[test]
fn under_a_sky_denoising_takes_nothing_that_the_samples_show() {
    let folder = tempfile::tempdir().unwrap();
    let matrix = |name: &str, samples: u32, seed: u64| {
        let mut sky = BuiltIn { width: 48, height: 40, texels: 16 }.named("environment").unwrap();
        (sky.settings.samples_per_pixel, sky.settings.seed) = (samples, seed);
        let path = folder.path().join(name);
        pipeline::render(sky, &path, &RenderOptions::default(), &NoProgress).unwrap();
        StoreReader::open(&path).unwrap()
    };
    let (seen, reference) = (matrix("seen.ltm", 64, 0), matrix("reference.ltm", 1024, 1));
    let path = folder.path().join("clean.ltc");
    pack(&seen, &path, &PackOptions { denoise: true, ..PackOptions::default() });
    let container = ContainerReader::open(&path).unwrap();
    let mut lightings: Vec<_> = evaluation_lightings(&seen.job().basis, 5).into_iter().map(|(_, l)| l).collect();
    // Without a spot on the ground, of which next to nothing is seen: 1/20,000 of the light.
    let light = |lighting| relight_raw(&reference, &[lighting]).unwrap().remove(0).values().iter().sum::<f32>();
    let all_on = light(lightings[0].clone());
    lightings.retain(|lighting| light(lighting.clone()) > 1e-3 * all_on);
    assert_eq!(lightings.len(), 11);
    let (packed, _) = pipeline::relight(&container, &lightings, RelightOptions::default(), &NoProgress).unwrap();
    let (raw, right) = (relight_raw(&seen, &lightings).unwrap(), relight_raw(&reference, &lightings).unwrap());
    let error = |images: &[LinearImage]| {
        images.iter().zip(&right).map(|(image, right)| compare(image, right).relative_l2).sum::<f64>()
    };
    let (packed, raw) = (error(&packed), error(&raw));
    assert!(packed < 0.9 * raw, "{packed}, and {raw} of the samples");
}

#[test]
fn images_denoised_elsewhere_go_out_and_come_back() {
    let folder = tempfile::tempdir().unwrap();
    let (_, matrix) = render(&folder, "diffuse");
    let at = |name: &str| folder.path().join(name);
    let images = pipeline::write_basis(&matrix, &at("basis.exr"), None, &NoProgress).unwrap();
    assert_eq!(images, 64);
    // Nothing is done to them: then the sum of all columns is the matrix's own.
    let options = |name: &str| PackOptions { denoise: true, basis: Some(at(name)), ..PackOptions::default() };
    pack(&matrix, &at("as-it-is.ltc"), &options("basis.exr"));
    let lighting = [Lighting::uniform(64, [1.0; 3]).unwrap()];
    let relit = |name: &str| {
        let container = ContainerReader::open(&at(name)).unwrap();
        pipeline::relight(&container, &lighting, RelightOptions::default(), &NoProgress).unwrap().0.remove(0)
    };
    let raw = relight_raw(&matrix, &lighting).unwrap().remove(0);
    let error = compare(&relit("as-it-is.ltc"), &raw).relative_l2;
    assert!(error < 2e-3, "{error}");
    // Brighter images make a brighter matrix, but for the lamps in view.
    let set = LightSet::open(&at("basis.exr"), Some(&r"^(basis\.\d+)$".parse().unwrap())).unwrap();
    let mut layers = vec![LinearImage::black(72, 40); images];
    set.read(&mut |row| {
        for (i, value) in row.values.iter().enumerate() {
            layers[row.image].pixels[row.y * 72 + row.x + i][row.channel] = 2.0 * value;
        }
        Ok(())
    })
    .unwrap();
    let named = |count: usize| -> Vec<(&str, &LinearImage)> {
        set.lights.iter().map(String::as_str).zip(&layers).take(count).collect()
    };
    write_exr_layers(&at("brighter.exr"), &named(images)).unwrap();
    pack(&matrix, &at("brighter.ltc"), &options("brighter.exr"));
    let (once, twice) = (relit("as-it-is.ltc"), relit("brighter.ltc"));
    // The lower half of the picture sees no lamp, nor a mirror that does.
    let sum = |image: &LinearImage| image.pixels[72 * 20..].as_flattened().iter().sum::<f32>();
    assert!((sum(&twice) / sum(&once) - 2.0).abs() < 0.02, "{} and {}", sum(&once), sum(&twice));

    write_exr_layers(&at("few.exr"), &named(images - 1)).unwrap();
    layers[0].pixels[5][1] = f32::NAN;
    let named: Vec<_> = set.lights.iter().map(String::as_str).zip(&layers).collect();
    write_exr_layers(&at("nan.exr"), &named).unwrap();
    let refused = |options: &PackOptions| {
        let error = pipeline::pack(&matrix, matrix.job(), &at("no.ltc"), options, &NoProgress).unwrap_err().to_string();
        assert!(!at("no.ltc").exists());
        error
    };
    assert!(refused(&options("few.exr")).contains("layer basis.63 is missing"));
    assert!(refused(&options("nan.exr")).contains("not finite"));
    assert!(
        refused(&PackOptions { denoise: false, ..options("basis.exr") }).contains("is for a matrix that is denoised")
    );
}

#[test]
fn denoised_images_are_nearer_to_the_truth_and_unlit_lamps_stay_dark() {
    // Of the mirror and the glass at this size hardly two pixels are alike; and photons leave less to clean: 0.50.
    for (name, most) in [("diffuse", 0.2), ("mixed", 0.55)] {
        let folder = tempfile::tempdir().unwrap();
        let (_, matrix) = render(&folder, name);
        let truth_path = folder.path().join("truth.ltm");
        let mut truth = room(name);
        (truth.settings.samples_per_pixel, truth.settings.seed) = (256, 99);
        pipeline::render(truth, &truth_path, &RenderOptions::default(), &NoProgress).unwrap();
        let truth = StoreReader::open(&truth_path).unwrap();
        let path = folder.path().join("clean.ltc");
        pack(&matrix, &path, &PackOptions { denoise: true, ..PackOptions::default() });
        let container = ContainerReader::open(&path).unwrap();
        let (mut raw, mut clean, mut glow) = (0.0, 0.0, 0.0f32);
        let (mut block, mut exact) = (TracedBlock::default(), TracedBlock::default());
        for id in matrix.shape().blocks() {
            matrix.read_block(id, &mut block).unwrap();
            truth.read_block(id, &mut exact).unwrap();
            let packed = container.read_layers(id, 0..container.layer_count(id)).unwrap().expand();
            // Half the panel lit.
            let lit: Vec<f32> = (0..64).map(|column| if column % 8 < 4 { 1.0 } else { 0.0 }).collect();
            let image = |entries: &[f32], row: usize| -> f32 {
                lit.iter().enumerate().map(|(column, weight)| weight * entries[column * packed.rows() + row]).sum()
            };
            // Lamps in view are the same in all of them but for the edges of texels, which few samples find by chance.
            let seen = [&exact, &block].map(|of| &of.planes.as_ref().unwrap().emission);
            let shows_a_lamp = |pixel: usize| seen.iter().any(|seen| seen.iter().any(|s| s.pixel as usize == pixel));
            let pixels = packed.rows() / 3;
            for row in 0..packed.rows() {
                let of = |entries: &[f32]| image(entries, row);
                let (t, r, c) = (of(exact.block.entries()), of(block.block.entries()), of(packed.entries()));
                if !shows_a_lamp(row % pixels) {
                    raw += f64::from(r.min(1.0) - t.min(1.0)).powi(2);
                    clean += f64::from(c.min(1.0) - t.min(1.0)).powi(2);
                } else if r == 0.0 {
                    glow = glow.max(c.abs());
                }
            }
        }
        assert!(clean < most * raw, "{name}: {clean} of {raw}");
        assert!(glow < 0.01, "{name}: what was dark shines at {glow}");
    }
}

/// Denoising goes down the image in strips, whose borders are those of blocks but at the end.
#[test]
fn images_of_any_height_keep_their_light_in_every_row() {
    for (width, height, side) in
        [(24, 72, 32), (24, 100, 32), (24, 144, 32), (40, 161, 16), (161, 24, 16), (16, 129, 64), (16, 200, 128)]
    {
        let folder = tempfile::tempdir().unwrap();
        let mut room = BuiltIn { width, height, texels: 4 }.named("diffuse").unwrap();
        (room.settings.samples_per_pixel, room.settings.block_side) = (16, side);
        let (stored, packed) = (folder.path().join("room.ltm"), folder.path().join("room.ltc"));
        pipeline::render(room, &stored, &RenderOptions::default(), &NoProgress).unwrap();
        let matrix = StoreReader::open(&stored).unwrap();
        pack(&matrix, &packed, &PackOptions { denoise: true, ..PackOptions::default() });
        let container = ContainerReader::open(&packed).unwrap();
        let shape = matrix.shape();
        let [mut before, mut after] = [0, 1].map(|_| vec![0.0f64; height as usize]);
        let mut block = TracedBlock::default();
        for id in shape.blocks() {
            matrix.read_block(id, &mut block).unwrap();
            let denoised = container.read_layers(id, 0..container.layer_count(id)).unwrap().expand();
            let rect = shape.rect(id);
            for (sums, entries) in [(&mut before, block.block.entries()), (&mut after, denoised.entries())] {
                for (i, entry) in entries.iter().enumerate() {
                    let pixel = i as u32 % (rect.width * rect.height);
                    sums[(rect.y + pixel / rect.width) as usize] += f64::from(*entry);
                }
            }
        }
        for (y, (before, after)) in before.iter().zip(&after).enumerate() {
            // The noise of a row of so few samples, and what the filter takes from rows above and below.
            assert!((0.7..1.4).contains(&(after / before)), "{width} × {height}, row {y}: {after} of {before}");
        }
        let sum = |rows: &[f64]| rows.iter().sum::<f64>();
        let kept = sum(&after) / sum(&before);
        assert!((kept - 1.0).abs() < 0.02, "{width} × {height}: {kept}");
    }
}

#[test]
fn a_pack_stopped_after_any_block_goes_on_and_ends_with_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, path) = (folder.path().join("whole.ltc"), folder.path().join("stopped.ltc"));
    pipeline::render_packed(room("mixed"), &whole, &PackOptions::default(), &NoProgress).unwrap();
    // Six blocks in each of two stages.
    let mut stops = 0;
    for stop in [1, 3, 5, 6, 8, 11] {
        let watch = StopAfter(AtomicU64::new(stop));
        let stopped = pipeline::render_packed(room("mixed"), &path, &PackOptions::default(), &watch);
        if let Err(error) = stopped {
            stops += 1;
            assert!(matches!(error, Error::Interrupted { .. }), "{error}");
            assert!(error.to_string().contains("stopped.ltc.spill keeps"), "{error}");
            assert!(!path.exists(), "nothing half-written under the final name");
            let (render, _) =
                pipeline::render_packed(room("mixed"), &path, &PackOptions::default(), &NoProgress).unwrap();
            assert!(render.blocks_kept >= stop.min(6), "{} kept after {stop}", render.blocks_kept);
        }
        assert!(fs::read(&path).unwrap() == fs::read(&whole).unwrap(), "stopped after {stop}");
        assert_eq!(names(folder.path()), ["stopped.ltc", "whole.ltc"]);
        fs::remove_file(&path).unwrap();
    }
    assert!(stops > 2, "stopped {stops} times: a stop in a stage that all threads have begun comes too late");
}

#[test]
fn other_settings_do_not_take_up_what_was_analysed_for_these() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltc");
    let watch = StopAfter(AtomicU64::new(3));
    assert!(pipeline::render_packed(room("mixed"), &path, &PackOptions::default(), &watch).is_err());
    let compress = CompressSettings { seed: 5, ..CompressSettings::default() };
    let mut options = PackOptions { compress, ..PackOptions::default() };
    let refused = pipeline::render_packed(room("mixed"), &path, &options, &NoProgress).err().unwrap().to_string();
    assert!(refused.contains("other input or settings"), "{refused}");
    options.container.overwrite = true;
    let (render, _) = pipeline::render_packed(room("mixed"), &path, &options, &NoProgress).unwrap();
    assert_eq!(render.blocks_kept, 0);
}

/// `Σ (packed − stored)²` over a block, entry by entry.
fn squared_error(stored: &TracedBlock, packed: &ltm::matrix::FactoredBlock) -> f64 {
    let expanded = packed.expand();
    let pairs = stored.block.entries().iter().zip(expanded.entries());
    pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum()
}

#[test]
fn the_stated_errors_are_those_of_the_stored_entries() {
    let folder = tempfile::tempdir().unwrap();
    let (_, matrix) = render(&folder, "mixed");
    let of = |method, rank, target| CompressSettings { target, rank, ..CompressSettings::of_method(method) };
    let cases = [
        of(Method::Auto, 24, Target::PsnrDb(35.0)),
        of(Method::Auto, 24, Target::PsnrDb(60.0)),
        of(Method::Auto, 3, Target::PsnrDb(80.0)),
        of(Method::BlockSvd, 6, Target::PsnrDb(50.0)),
        of(Method::BlockPca, 6, Target::PsnrDb(50.0)),
        of(Method::Proposed, 8, Target::PsnrDb(50.0)),
    ];
    for (i, compress) in cases.into_iter().enumerate() {
        let path = folder.path().join(format!("{i}.ltc"));
        let what = format!("{} {:?}", compress.method, compress.target);
        let report = pack(&matrix, &path, &PackOptions { compress, ..PackOptions::default() });
        let container = ContainerReader::open(&path).unwrap();
        let (mut errors, mut norms) = (0.0, 0.0);
        for id in matrix.job().shape.blocks() {
            let (block, packed) = divided::divided(&matrix, &container, id);
            let error = squared_error(&block, &packed);
            let stated = container.block_report(id);
            let norm: f64 = block.block.entries().iter().map(|&v| f64::from(v).powi(2)).sum();
            if norm == 0.0 {
                assert_eq!((stated.squared_norm, stated.squared_error, error), (0.0, 0.0, 0.0), "{what}, {id}");
                continue;
            }
            // Running sums of f32 squares, 192 in each.
            assert!(
                (stated.squared_norm - norm).abs() <= 1e-5 * norm,
                "{what}, {id}: {} for {norm}",
                stated.squared_norm
            );
            // The rounding of L against what the components lack: a standard deviation of at most 1/√rows, which is
            // 7.2 % for the smallest block (8 × 8 pixels) and 1.8 % for a whole one. Three of them, and the rounding
            // of f32 products.
            let rows = block.block.rows() as f64;
            let bound = 3.0 / rows.sqrt() * error + 1e-10 * norm;
            assert!((stated.squared_error - error).abs() < bound, "{what}, {id}: {} for {error}", stated.squared_error);
            let image = |block: &ltm::matrix::Block| -> Vec<f64> {
                let mut image = vec![0.0; block.rows()];
                for column in block.entries().chunks_exact(block.rows()) {
                    image.iter_mut().zip(column).for_each(|(sum, &v)| *sum += f64::from(v));
                }
                image
            };
            let (a, b) = (image(&block.block), image(&packed.expand()));
            let off: f64 = a.iter().zip(&b).map(|(a, b)| (a - b).powi(2)).sum();
            let uniform = (off / a.iter().map(|v| v * v).sum::<f64>()).sqrt();
            // The image is kept in f32, 72 pixels' worth of rounding at most.
            let off = (stated.uniform_error - uniform).abs();
            assert!(off < 0.01 * uniform + 1e-5, "{what}, {id}: {} for {uniform}", stated.uniform_error);
            errors += error;
            norms += norm;
        }
        let relative = (errors / norms).sqrt();
        assert!((report.relative_l2 / relative - 1.0).abs() < 0.01, "{what}: {} for {relative}", report.relative_l2);
    }
}

/// Squared error and norm of each column and of images under some lightings, and squared noise of each column, summed over
/// the blocks entry by entry.
struct Exact {
    columns: Vec<[f64; 3]>,
    images: Vec<[f64; 2]>,
}

fn exactly(matrix: &StoreReader, container: &ContainerReader, lightings: &[Vec<f64>]) -> Exact {
    let n = matrix.job().shape.columns();
    let mut exact = Exact { columns: vec![[0.0; 3]; n], images: vec![[0.0; 2]; lightings.len()] };
    for id in matrix.job().shape.blocks() {
        let (block, packed) = divided::divided(matrix, container, id);
        let packed = packed.expand();
        let rows = block.block.rows();
        let noise = block.noise.as_ref().expect("the tracer keeps it");
        for (j, sums) in exact.columns.iter_mut().enumerate() {
            for (a, b) in block.block.entries()[j * rows..][..rows].iter().zip(&packed.entries()[j * rows..]) {
                sums[0] += f64::from(a - b).powi(2);
                sums[1] += f64::from(*a).powi(2);
            }
            sums[2] += f64::from(noise.column_variance[j]) * rows as f64;
        }
        for (lighting, sums) in lightings.iter().zip(&mut exact.images) {
            for row in 0..rows {
                let lit = |entries: &[f32]| -> f64 {
                    lighting.iter().enumerate().map(|(j, w)| w * f64::from(entries[j * rows + row])).sum()
                };
                let (a, b) = (lit(block.block.entries()), lit(packed.entries()));
                sums[0] += (a - b).powi(2);
                sums[1] += a * a;
            }
        }
    }
    exact
}

#[test]
fn what_single_and_random_lights_are_said_to_lose_is_what_they_lose() {
    let folder = tempfile::tempdir().unwrap();
    let (_, matrix) = render(&folder, "mixed");
    let n = matrix.job().shape.columns();
    let mut random = Pcg64Mcg::seed_from_u64(1);
    let mut lightings = vec![vec![1.0; n]];
    lightings.extend((0..100).map(|_| (0..n).map(|_| random.random::<f64>()).collect()));
    let of = |noise_factor, target| CompressSettings { target, noise_factor, ..CompressSettings::default() };
    let svd = CompressSettings { rank: 5, ..CompressSettings::of_method(Method::BlockSvd) };
    for (i, compress) in [CompressSettings::default(), of(None, Target::PsnrDb(30.0)), svd].into_iter().enumerate() {
        let path = folder.path().join(format!("{i}.ltc"));
        let report = pack(&matrix, &path, &PackOptions { compress, ..PackOptions::default() });
        let container = ContainerReader::open(&path).unwrap();
        let said = container.errors().lights.unwrap();
        assert_eq!(report.lights, said);
        let exact = exactly(&matrix, &container, &lightings);
        let ratio = |a: f64, b: f64| (a / b).sqrt();
        let error: Vec<f64> = exact.columns.iter().map(|c| ratio(c[0], c[1])).collect();
        let mean = error.iter().sum::<f64>() / n as f64;
        let worst = error.iter().copied().fold(0.0, f64::max);
        // The term that is left out of each column's squared error has a standard deviation of at most 1/√8640 of it, 1.1 %.
        let near = |said: f32, exact: f64| (f64::from(said) / exact - 1.0).abs() < 0.03;
        assert!(near(said.single_mean, mean), "{said:?}: {mean}");
        assert!(near(said.single_worst, error[said.worst_column as usize]), "{said:?}");
        assert!(error[said.worst_column as usize] > 0.97 * worst, "{said:?}: {worst}");
        let noise = exact.columns.iter().map(|c| ratio(c[2], c[1])).sum::<f64>() / n as f64;
        assert!(near(said.noise_mean, noise), "{said:?}: {noise}");
        let all_on = ratio(exact.images[0][0], exact.images[0][1]);
        // Where it is nearly exact it is the rounding of f32 sums.
        assert!((f64::from(said.all_on) - all_on).abs() < 0.01 * all_on + 1e-6, "{said:?}: {all_on}");
        let drawn = exact.images[1..].iter().fold([0.0, 0.0], |sum, i| [sum[0] + i[0], sum[1] + i[1]]);
        // A hundred draws: about a tenth where a few directions carry the error, and the root halves it.
        assert!((f64::from(said.random) / ratio(drawn[0], drawn[1]) - 1.0).abs() < 0.15, "{said:?}: {drawn:?}");
    }
}

#[test]
fn memory_that_is_too_small_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.ltc");
    let options = PackOptions { memory_bytes: Some(1 << 20), ..PackOptions::default() };
    let error = pipeline::render_packed(room("mixed"), &path, &options, &NoProgress).unwrap_err();
    assert!(matches!(error, Error::Resources { .. }) && error.to_string().contains("1.0 MiB"), "{error}");
    let options = RenderOptions { memory_bytes: Some(1 << 20), ..RenderOptions::default() };
    let error = pipeline::render(room("mixed"), &folder.path().join("a.ltm"), &options, &NoProgress).unwrap_err();
    assert!(matches!(error, Error::Resources { .. }), "{error}");
    assert_eq!(names(folder.path()), [""; 0]);
}

#[test]
fn a_scene_that_the_tracer_refuses_leaves_no_file() {
    let folder = tempfile::tempdir().unwrap();
    let mut room = room("mixed");
    room.settings.samples_per_pixel = 0;
    let error = pipeline::render_packed(room, &folder.path().join("a.ltc"), &PackOptions::default(), &NoProgress);
    assert!(error.unwrap_err().to_string().contains("samples per pixel"));
    assert_eq!(names(folder.path()), [""; 0]);
}

#[test]
fn rows_and_columns_of_the_whole_matrix_give_the_same_bytes_whenever_it_was_stopped() {
    let folder = tempfile::tempdir().unwrap();
    let (_, matrix) = render(&folder, "diffuse");
    let (whole, path) = (folder.path().join("whole.ltc"), folder.path().join("stopped.ltc"));
    let compress =
        CompressSettings { scope: Scope::Global, rank: 12, ..CompressSettings::of_method(Method::Algorithm4) };
    let options = PackOptions { compress, ..PackOptions::default() };
    let report = pack(&matrix, &whole, &options);
    let compress = CompressSettings { scope: Scope::Block, ..options.compress.clone() };
    let blocks = pack(&matrix, &path, &PackOptions { compress, ..options.clone() });
    // A lamp in view has as many directions as texels, which twelve columns miss either way; the same choice for all
    // blocks fits each of them less or, with more rows to choose from, better: seen between 0.76 and 1.17 times.
    assert!(report.relative_l2 < 1.5 * blocks.relative_l2 && report.mean_rank <= 12.0, "{report}; {blocks}");
    fs::remove_file(&path).unwrap();
    // Six blocks, read twice before they are analysed.
    let mut stops = 0;
    for stop in [1, 8, 15, 20] {
        let watch = StopAfter(AtomicU64::new(stop));
        if let Err(error) = pipeline::pack(&matrix, matrix.job(), &path, &options, &watch) {
            stops += 1;
            assert!(matches!(error, Error::Interrupted { .. }), "{error}");
            pack(&matrix, &path, &options);
        }
        assert!(fs::read(&path).unwrap() == fs::read(&whole).unwrap(), "stopped after {stop}");
        fs::remove_file(&path).unwrap();
    }
    assert!(stops > 1, "stopped {stops} times");
    let error = pipeline::render_packed(room("diffuse"), &path, &options, &NoProgress).unwrap_err().to_string();
    assert!(error.contains("never stored") && error.contains("pack the stored matrix"), "{error}");
    assert_eq!(names(folder.path()), ["diffuse.ltm", "whole.ltc"]);
}

#[test]
fn a_target_that_the_noise_puts_out_of_reach_is_said_with_the_way_on() {
    let folder = tempfile::tempdir().unwrap();
    let (_, matrix) = render(&folder, "diffuse");
    let packed = |target: Target, noise_factor: Option<f64>| {
        let compress = CompressSettings { target, noise_factor, ..CompressSettings::default() };
        let mut options = PackOptions { compress, ..PackOptions::default() };
        options.container.overwrite = true;
        pack(&matrix, &folder.path().join("short.ltc"), &options)
    };
    let heeded = CompressSettings::default().noise_factor;
    let short = packed(Target::PsnrDb(60.0), heeded);
    let shortfall = short.short_of_target.expect("four samples a pixel are nowhere near 60 dB");
    assert!(shortfall.noise_heeded && shortfall.psnr_db < 40.0, "{shortfall}");
    let said = short.to_string();
    assert!(
        said.contains("the noise of the samples") && said.contains("60 dB") && said.contains("`noise_factor`"),
        "{said}"
    );
    let stopped = packed(Target::Automatic, heeded);
    assert!(stopped.to_string().contains("stopped at the noise of the samples"), "{stopped}");
    // What only the noise stops is the same for every target beyond it.
    let path = folder.path().join("short.ltc");
    let (bytes, _) = (fs::read(&path).unwrap().len(), packed(Target::PsnrDb(60.0), heeded));
    assert!(bytes.abs_diff(fs::read(&path).unwrap().len()) < 200, "{bytes}");
    for (target, noise_factor) in
        [(Target::PsnrDb(5.0), heeded), (Target::Bytes(2000), heeded), (Target::PsnrDb(15.0), None)]
    {
        let reached = packed(target, noise_factor);
        let said = reached.to_string();
        let lines = said.lines().filter(|line| !line.starts_with("warning: light 'ceiling' alone is "));
        assert!(reached.short_of_target.is_none() && lines.count() == 1, "{reached}");
    }
    let over = packed(Target::Bytes(1), heeded);
    let shortfall = over.short_of_target.expect("no file has one byte");
    assert_eq!(shortfall.file_bytes, fs::metadata(&path).unwrap().len());
    assert!(over.to_string().contains("more than the target, 1 B"), "{over}");
}

/// Texels of the panel over the lit floor.
const FLOOR_TEXELS: usize = 256;

/// A floor in uneven light: a panel of 16 × 16 texels over it, and four lamps each of which lights it a fiftieth as much as the whole panel.
fn lit_floor(x: f32, y: f32, column: usize) -> f32 {
    let texel = |i: usize| ((i % 16) as f32 / 16.0, (i / 16) as f32 / 16.0);
    let (u, v) = texel(column.checked_sub(FLOOR_TEXELS).map_or(column, |lamp| 70 + 37 * lamp));
    let share = if column < FLOOR_TEXELS { 1.0 / FLOOR_TEXELS as f32 } else { 1.0 / 50.0 };
    let uneven = 1.0 + 0.3 * (37.0 * x + 91.0 * u).sin() * (53.0 * y + 71.0 * v).cos();
    share * uneven / ((x - u).powi(2) + (y - v).powi(2) + 0.25)
}

/// Each texel is rounded once, and all at once are seen: 16 times the error of one, where no more is done.
#[test]
fn a_panel_by_itself_is_as_near_as_a_lamp_of_a_fiftieth_of_its_light() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("floor.ltc");
    let mut basis = LightBasis::new();
    basis.push(Light::unplaced("panel", LightKind::AreaTexels { across: 16, down: 16 })).unwrap();
    ["a", "b", "c", "d"].iter().for_each(|name| {
        basis.push(Light::unplaced(*name, LightKind::Lamp)).unwrap();
    });
    let pixel = |x, y, column| [lit_floor(x as f32 / 64.0, y as f32 / 48.0, column); 3];
    let source = MemoryMatrix::from_fn((64, 48), basis, pixel).unwrap();
    let compress = CompressSettings { target: Target::PsnrDb(45.0), noise_factor: None, ..Default::default() };
    let options = PackOptions { compress, ..PackOptions::default() };
    ltm::pack(&source, &path, &options).unwrap();
    let container = ContainerReader::open(&path).unwrap();
    // With the factors as they are held in memory.
    let error = |columns: std::ops::Range<usize>| {
        let weight = |column: usize| if columns.contains(&column) { [1.0; 3] } else { [0.0; 3] };
        let lightings = [Lighting::new((0..260).map(weight).collect()).unwrap()];
        let (images, _) = pipeline::relight(&container, &lightings, RelightOptions::default(), &NoProgress).unwrap();
        let pixels = images[0].pixels.iter().enumerate();
        let squares = pixels.map(|(i, pixel)| {
            let (x, y) = ((i % 64) as f32 / 64.0, (i / 64) as f32 / 48.0);
            let truth: f32 = columns.clone().map(|column| lit_floor(x, y, column)).sum();
            f64::from(pixel[0] - truth).powi(2)
        });
        (squares.sum::<f64>() / (64.0 * 48.0)).sqrt()
    };
    let panel = error(0..256);
    let lamps = (256..260).map(|lamp| error(lamp..lamp + 1)).sum::<f64>() / 4.0;
    // 0.73 of it; with one step for all bands of right sides 1.17.
    assert!(panel < lamps, "{panel} over {lamps}");
}
