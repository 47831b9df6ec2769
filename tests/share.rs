//! Shared pages: the bytes of the data, and what is refused. The page itself is tested in a browser, by `page`.

use std::fs;
use std::io::Read;
use std::path::{Path, PathBuf};

use flate2::read::DeflateDecoder;
use ltm::Error;
use ltm::container::ContainerReader;
use ltm::light::Lighting;
use ltm::matrix::FactorSource;
use ltm::pipeline::{self, DATA_NAME, PAGE_NAME, PackOptions, ShareOptions, ShareView};
use ltm::resources::NoProgress;
use ltm::scene::BuiltIn;
use ltm::share::SharedLook;
use serde_json::Value;
use tempfile::TempDir;

/// A packed room of several blocks, those at two edges not full, under a panel of 8 × 8 texels.
fn packed(folder: &TempDir) -> PathBuf {
    let mut loaded = BuiltIn { width: 150, height: 70, texels: 8 }.named("diffuse").unwrap();
    loaded.settings.samples_per_pixel = 16;
    let path = folder.path().join("room.ltc");
    pipeline::render_packed(loaded, &path, &PackOptions::default(), &NoProgress).unwrap();
    path
}

fn share(container: &Path, output: &Path, options: &ShareOptions) -> ltm::Result<pipeline::ShareReport> {
    pipeline::share(&[ShareView::of(&ContainerReader::open(container)?)], output, options, &NoProgress)
}

/// Head and the bytes after it.
fn parsed(data: &[u8]) -> (Value, &[u8]) {
    let number = |at: usize| u32::from_le_bytes(data[at..at + 4].try_into().unwrap());
    assert_eq!((&data[..8], number(8)), (&b"\x89LTS\r\n\x1a\n"[..], 1));
    let (head, rest) = data[20..].split_at(number(12) as usize);
    assert_eq!(crc32fast::hash(head), number(16));
    let mut json = String::new();
    DeflateDecoder::new(head).read_to_string(&mut json).unwrap();
    (serde_json::from_str(&json).unwrap(), rest)
}

/// The chunks of a layer, by block: held to its index.
fn chunks<'a>(layer: &Value, blocks: usize, rest: &'a [u8]) -> Vec<&'a [u8]> {
    let number = |key: &str| layer[key].as_u64().unwrap() as usize;
    let (offset, index_bytes) = (number("offset"), number("indexBytes"));
    let mut index = &rest[offset..offset + index_bytes];
    assert_eq!(crc32fast::hash(index), number("indexCrc") as u32);
    let mut at = offset + index_bytes;
    let found = (0..blocks).map(|_| {
        let (mut size, mut shift) = (0usize, 0);
        loop {
            let (byte, after) = index.split_first().unwrap();
            index = after;
            size |= usize::from(byte & 0x7f) << shift;
            shift += 7;
            if byte & 0x80 == 0 {
                break;
            }
        }
        let chunk = &rest[at..at + size];
        at += size;
        if size > 0 {
            let (crc, after) = index.split_at(4);
            assert_eq!(crc, crc32fast::hash(chunk).to_le_bytes());
            index = after;
        }
        chunk
    });
    let found = found.collect();
    assert!(index.is_empty() && at == offset + index_bytes + number("chunkBytes"));
    found
}

#[test]
fn the_data_are_the_containers_chunks_behind_a_small_preview() {
    let folder = tempfile::tempdir().unwrap();
    let container = packed(&folder);
    let site = folder.path().join("site");
    let reader = ContainerReader::open(&container).unwrap();
    let job = reader.job();
    let lighting = Lighting::uniform(job.shape.columns(), [0.5, 0.25, 0.1]).unwrap();
    let looks = vec![SharedLook { name: "\"half\"".into(), lighting }];
    let options = ShareOptions { title: "A <room>".into(), ..Default::default() };
    let views = [ShareView { looks, ..ShareView::of(&reader) }];
    let share = |output: &Path, options: &ShareOptions| pipeline::share(&views, output, options, &NoProgress);
    let report = share(&site, &options).unwrap();
    let (data, page) = (fs::read(site.join(DATA_NAME)).unwrap(), fs::read_to_string(site.join(PAGE_NAME)).unwrap());
    assert_eq!((report.data.total, report.page_bytes), (data.len() as u64, page.len() as u64));
    assert!(page.contains("<title>A &lt;room&gt;</title>"));

    let (head, rest) = parsed(&data);
    assert_eq!(head["title"], "A <room>");
    assert_eq!(head["lights"].as_array().unwrap().len(), job.basis.lights().len());
    assert_eq!(head["looks"][0]["name"], "\"half\"");
    assert_eq!(head["panorama"], false);
    let whole = &head["levels"][1];
    assert_eq!((whole["width"].as_u64(), whole["height"].as_u64()), (Some(150), Some(70)));
    let blocks: Vec<_> = job.shape.blocks().collect();
    for (layer, entry) in whole["layers"].as_array().unwrap().iter().enumerate() {
        for (&id, chunk) in blocks.iter().zip(chunks(entry, blocks.len(), rest)) {
            let stored = (layer as u32) < reader.layer_count(id);
            let expected = if stored { reader.stored_layer(id, layer as u32).unwrap() } else { Vec::new() };
            assert_eq!(chunk, expected, "{id}, layer {layer}");
        }
    }
    for (i, &id) in blocks.iter().enumerate() {
        assert_eq!(whole["ranks"][i].as_u64(), Some(reader.rank(id) as u64));
        assert_eq!(whole["sparse"][i].as_u64(), Some(reader.sparse_entries(id) as u64));
    }
    let preview = &head["levels"][0];
    assert_eq!((preview["width"].as_u64(), preview["height"].as_u64()), (Some(38), Some(18)));
    assert_eq!(chunks(&preview["layers"][0], 2, rest).len(), 2);
    // Beside the container there are the head, checksums in place of longer records, and the preview.
    assert!(report.data.total as f64 <= 1.3 * reader.file_bytes() as f64, "{report:?}");
    assert!(report.data.to_preview < report.data.to_base && report.data.to_base <= report.data.total);

    // The same again gives the same bytes, and only where it may.
    let refused = share(&site, &options).unwrap_err();
    assert!(matches!(refused, Error::Input { .. }) && refused.to_string().contains("`overwrite`"), "{refused}");
    share(&site, &ShareOptions { overwrite: true, ..options.clone() }).unwrap();
    assert_eq!(fs::read(site.join(DATA_NAME)).unwrap(), data);

    // One file has the same data inside.
    let single = folder.path().join("room.html");
    let report = share(&single, &ShareOptions { single: true, ..options }).unwrap();
    let html = fs::read_to_string(&single).unwrap();
    assert_eq!((report.total_bytes, report.data.total), (html.len() as u64, data.len() as u64));
    let text = html.split_once("vnd.ltm.share\">").unwrap().1.split('<').next().unwrap();
    assert_eq!(text.len(), data.len().div_ceil(3) * 4);
}

#[test]
fn several_views_have_their_data_beside_one_page() {
    let folder = tempfile::tempdir().unwrap();
    let container = packed(&folder);
    let (site, single) = (folder.path().join("site"), folder.path().join("two.html"));
    let reader = ContainerReader::open(&container).unwrap();
    let named = |name: &str| ShareView { name: name.into(), ..ShareView::of(&reader) };
    let views = [named("lobby"), named("bar & grill")];
    let options = ShareOptions { title: "Hotel".into(), ..Default::default() };
    let report = pipeline::share(&views, &site, &options, &NoProgress).unwrap();
    let [first, second] = [0, 1].map(|view| fs::read(site.join(pipeline::data_name(view))).unwrap());
    let page = fs::read_to_string(site.join(PAGE_NAME)).unwrap();
    assert!(page.contains("data-view=\"lobby\"") && page.contains("data-view=\"bar &amp; grill\""));
    assert_eq!(report.total_bytes, (first.len() + second.len() + page.len()) as u64);
    // Each is what the container alone has, under the page's one title and exposure.
    share(&container, &folder.path().join("alone"), &options).unwrap();
    assert!(first == second && first == fs::read(folder.path().join("alone").join(DATA_NAME)).unwrap());
    let options = ShareOptions { single: true, ..options };
    let report = pipeline::share(&views, &single, &options, &NoProgress).unwrap();
    let html = fs::read_to_string(&single).unwrap();
    assert_eq!((report.total_bytes, html.matches("vnd.ltm.share\"").count()), (html.len() as u64, 2));
    assert!(pipeline::share(&[], &single, &options, &NoProgress).unwrap_err().to_string().contains("no view"));
    fs::remove_file(site.join(DATA_NAME)).unwrap();
    fs::remove_file(site.join(PAGE_NAME)).unwrap();
    let refused = pipeline::share(&views, &site, &ShareOptions { single: false, ..options }, &NoProgress).unwrap_err();
    assert!(refused.to_string().contains("picture-2.lts"), "{refused}");
}

#[test]
fn a_damaged_container_is_refused_and_what_was_shared_before_stays() {
    let folder = tempfile::tempdir().unwrap();
    let container = packed(&folder);
    let site = folder.path().join("site");
    share(&container, &site, &ShareOptions::default()).unwrap();
    let before = fs::read(site.join(DATA_NAME)).unwrap();
    let mut bytes = fs::read(&container).unwrap();
    bytes[200] ^= 1;
    fs::write(&container, bytes).unwrap();
    let options = ShareOptions { overwrite: true, ..Default::default() };
    let refused = share(&container, &site, &options).unwrap_err();
    assert!(matches!(refused, Error::Damaged { .. }), "{refused}");
    assert_eq!(fs::read(site.join(DATA_NAME)).unwrap(), before);
    assert_eq!(fs::read_dir(&site).unwrap().count(), 2);
}

#[test]
fn an_output_that_cannot_be_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let container = packed(&folder);
    let file = folder.path().join("file");
    fs::write(&file, "x").unwrap();
    for output in [file, folder.path().join("missing/site")] {
        let refused = share(&container, &output, &ShareOptions::default()).unwrap_err();
        assert!(matches!(refused, Error::Input { .. }), "{refused}");
    }
    let options = ShareOptions { single: true, overwrite: true, ..Default::default() };
    assert!(share(&container, folder.path(), &options).unwrap_err().to_string().contains("is a folder"));
    let options = ShareOptions { memory_bytes: Some(1 << 20), ..Default::default() };
    let refused = share(&container, &folder.path().join("site"), &options).unwrap_err();
    assert!(matches!(refused, Error::Resources { .. }), "{refused}");
}
