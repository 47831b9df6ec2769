//! The examples do what they say.

#[allow(dead_code, reason = "its main is for people")]
#[path = "../examples/pack_array.rs"]
mod pack_array;
#[allow(dead_code, reason = "its main is for people")]
#[path = "../examples/read_blocks.rs"]
mod read_blocks;
#[allow(dead_code, reason = "its main is for people")]
#[path = "../examples/relight.rs"]
mod relight;
#[allow(dead_code, reason = "its main is for people")]
#[path = "../examples/write_and_pack.rs"]
mod write_and_pack;

use ltm::image::read_image;
use ltm::matrix::BlockId;
use ltm::{Lighting, MatrixFile};

#[test]
fn a_packed_array_is_read_and_relit() {
    let folder = tempfile::tempdir().unwrap();
    let (wall, image) = (folder.path().join("wall.ltc"), folder.path().join("wall.exr"));
    let report = pack_array::pack_wall(&wall).unwrap();
    assert!(report.relative_l2 < 0.01, "{report}");

    // The lamps stand in a row, the same from both of its ends.
    let means = read_blocks::means(&wall).unwrap();
    assert_eq!(means.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>()[..2], ["'lamp 0'", "'lamp 1'"]);
    for (column, (_, mean)) in means.iter().enumerate() {
        assert!((mean / means[7 - column].1 - 1.0).abs() < 0.01, "{means:?}");
    }

    // Without the lamps 1 to 7 there is what lamp 0 gives: brightest above it.
    relight::without(&wall, "lamp [1-7]", &image).unwrap_err();
    relight::without(&wall, "lamp 0", &image).unwrap();
    let others = read_image(&image).unwrap();
    let matrix = ltm::open(&wall).unwrap();
    assert!(matches!(matrix.file(), MatrixFile::Container(_)));
    let lit = |lighting: Lighting| matrix.relight(&lighting).unwrap();
    let (all, one) =
        (lit(Lighting::of_scene(matrix.basis())), lit(Lighting::off(matrix.basis()).with("lamp 0", 1.0).unwrap()));
    for ((all, one), others) in all.pixels.iter().zip(&one.pixels).zip(&others.pixels) {
        // To the rounding of sums of f32 in another order.
        assert!((all[0] - one[0] - others[0]).abs() < 1e-4 * all[0], "{all:?} {one:?} {others:?}");
    }
    // Half a pixel to the right of the lamp and below it; packed to about 40 dB.
    assert!((one.pixels[4][0] * 25.5 / 100.0 - 1.0).abs() < 0.02, "{:?}", one.pixels[4]);
}

#[test]
fn a_stored_matrix_relights_as_its_container() {
    let folder = tempfile::tempdir().unwrap();
    let report = write_and_pack::write_and_pack(folder.path()).unwrap();
    let open = |name: &str| ltm::open(folder.path().join(name)).unwrap();
    let (stored, packed) = (open("wall.ltm"), open("wall.ltc"));
    assert!(matches!(stored.file(), MatrixFile::Stored(_)));
    let lighting = Lighting::of_scene(stored.basis()).with("lamp 3", [0.0, 5.0, 0.0]).unwrap();
    let (exact, packed) = (stored.relight(&lighting).unwrap(), packed.relight(&lighting).unwrap());
    let squares = |values: &mut dyn Iterator<Item = f32>| values.map(|v| f64::from(v).powi(2)).sum::<f64>();
    let difference = squares(&mut exact.values().iter().zip(packed.values()).map(|(a, b)| a - b));
    let error = (difference / squares(&mut exact.values().iter().copied())).sqrt();
    assert!(error > 0.0 && error < 3.0 * report.relative_l2, "{error} of {report}");
    assert_eq!(stored.read_block(BlockId(1)).unwrap().rows(), 32 * 32 * 3);
}

#[test]
fn a_file_opens_by_its_content_and_says_what_is_damaged() {
    let folder = tempfile::tempdir().unwrap();
    let wall = folder.path().join("wall.ltc");
    pack_array::pack_wall(&wall).unwrap();
    let renamed = folder.path().join("wall");
    std::fs::rename(&wall, &renamed).unwrap();
    let matrix = ltm::open(&renamed).unwrap();
    let image = matrix.relight(&Lighting::of_scene(matrix.basis())).unwrap();
    let again = matrix.relight(&Lighting::of_scene(matrix.basis())).unwrap();
    assert_eq!((image.width, image.height, &image.pixels), (64, 48, &again.pixels));

    // The last byte of the first block's layer.
    let mut bytes = std::fs::read(&renamed).unwrap();
    let at = bytes.len() / 3;
    bytes[at] ^= 0xff;
    std::fs::write(&renamed, bytes).unwrap();
    let damaged = ltm::open(&renamed).unwrap();
    let error = damaged.relight(&Lighting::of_scene(damaged.basis())).unwrap_err();
    assert_eq!(error.kind(), ltm::error::ErrorKind::Damaged, "{error}");
}
