//! What the samples of a block are, as it lies behind the rest of its tile.

use crate::matrix::{BlockPlanes, CHANNELS, SeenEmission, decode_unsigned, encode_unsigned};

use super::StoreLayout;
use super::header::FEATURES_WITHOUT_PIXEL_ALBEDO;
use super::record::PlanesRecord;

/// The bytes of a block's planes: features, then variances and light in 16 bits, padding to 4, emission.
pub(super) fn encode_planes(planes: &BlockPlanes, layout: &StoreLayout) -> Vec<u8> {
    let kept = planes.pixels() * layout.features as usize;
    let (features, variances) = (&planes.features[..kept], &planes.feature_variance[..kept]);
    let short: usize = kept + planes.direct.iter().chain(&planes.indirect).map(Vec::len).sum::<usize>();
    let seen: &[u8] = bytemuck::cast_slice(&planes.emission);
    let mut bytes = Vec::with_capacity(size_of_val(features) + 2 * short + 2 + seen.len());
    bytes.extend_from_slice(bytemuck::cast_slice(features));
    let light = planes.direct.iter().chain(&planes.indirect);
    for &value in variances.iter().chain(light.flatten()) {
        bytes.extend_from_slice(&encode_unsigned(value).to_le_bytes());
    }
    bytes.resize(bytes.len().next_multiple_of(4), 0);
    bytes.extend_from_slice(seen);
    bytes
}

/// Reads them back into `target` from bytes whose checksum has been found to hold and whose length is that of the
/// layout. Errors, as plain text for the caller to place: what no block can have.
pub(super) fn decode_planes(
    bytes: &[u8],
    layout: &StoreLayout,
    rows: usize,
    record: PlanesRecord,
    target: &mut BlockPlanes,
) -> Result<(), String> {
    let pixels = rows / CHANNELS;
    target.reset(pixels, layout.clusters as usize);
    let kept = pixels * layout.features as usize;
    let BlockPlanes { direct, indirect, features: means, feature_variance: variances, .. } = target;
    for planes in [&mut *means, variances] {
        planes[kept..].fill(0.0);
    }
    let (features, rest) = bytes.split_at(kept * 4);
    for (value, bytes) in means.iter_mut().zip(features.chunks_exact(4)) {
        *value = bytemuck::pod_read_unaligned(bytes);
    }
    let (rest, seen) = rest.split_at(rest.len() - record.seen as usize * size_of::<SeenEmission>());
    let light = direct.iter_mut().chain(indirect);
    for (value, bytes) in variances[..kept].iter_mut().chain(light.flatten()).zip(rest.chunks_exact(2)) {
        *value = decode_unsigned(bytemuck::pod_read_unaligned(bytes));
    }
    if layout.features <= FEATURES_WITHOUT_PIXEL_ALBEDO {
        target.pixel_albedo_of_samples();
    }
    target.emission.reserve_exact(record.seen as usize);
    target
        .emission
        .extend(seen.chunks_exact(size_of::<SeenEmission>()).map(bytemuck::pod_read_unaligned::<SeenEmission>));
    let inside =
        |seen: &SeenEmission| (seen.pixel as usize) < pixels && (seen.column as usize) < layout.shape.columns();
    let place = |seen: &SeenEmission| (seen.pixel, seen.column);
    match target.emission.iter().all(inside) && target.emission.is_sorted_by(|a, b| place(a) < place(b)) {
        true => Ok(()),
        false => Err("its list of emitters in view is out of order or range".into()),
    }
}
