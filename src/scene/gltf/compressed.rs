//! Compressed meshes: `KHR_draco_mesh_compression` of primitives, `EXT_meshopt_compression` of buffer views.
//!
//! A decoder is bounded by what is left of the memory, and by how much there can be in the bytes that it is given.

use draco_core::{DecodeLimits, DecoderBuffer, Mesh, MeshDecoder};
use meshoptimizer_rs::Workspace;
use meshoptimizer_rs::codec::{BufferView, Filter, Mode, decode_filter_color};

/// Bytes that one byte of a stream stands for at most. Streams of constants alone have more.
const MAX_RATIO: usize = 4096;

/// A decoded primitive.
pub(super) struct Draco(Mesh);

impl Draco {
    /// Decodes a stream to at most `memory` bytes. Errors: why that cannot be done.
    pub(super) fn decode(bytes: &[u8], memory: u64) -> Result<Self, String> {
        // Decoding takes some times what it makes.
        let most = (memory / 4).min(bytes.len().saturating_mul(MAX_RATIO) as u64);
        // A point or a face has twelve bytes or more.
        let limits = DecodeLimits::default().with_max_decoded_bytes(most);
        let limits = limits.with_max_points(most / 12).with_max_faces(most / 12);
        let mut mesh = Mesh::new();
        let mut buffer = DecoderBuffer::new(bytes).with_limits(limits);
        match MeshDecoder::new().decode(&mut buffer, &mut mesh) {
            Ok(()) => Ok(Self(mesh)),
            Err(error) => Err(error.to_string()),
        }
    }

    pub(super) fn points(&self) -> usize {
        self.0.num_points()
    }

    /// Corners of its triangles, not checked.
    pub(super) fn indices(&self) -> Vec<u32> {
        self.0.faces().iter().flatten().map(|point| point.0).collect()
    }

    /// The attribute of an id: `width` numbers for each point. None where it has no such attribute.
    pub(super) fn numbers(&self, id: usize, width: usize) -> Option<Vec<f32>> {
        let attribute = self.0.attribute_by_unique_id(u32::try_from(id).ok()?)?;
        let numbers = attribute.read_f32s(self.points(), width);
        (usize::from(attribute.num_components()) == width && numbers.len() == self.points() * width).then_some(numbers)
    }
}

/// The bytes of a view of `count` elements of `stride` bytes. Errors: why they cannot be decoded.
pub(super) fn meshopt(
    bytes: &[u8],
    mode: &str,
    filter: &str,
    count: usize,
    stride: usize,
) -> Result<Vec<u8>, &'static str> {
    const BAD: &str = "does not say how it is compressed";
    const DAMAGED: &str = "is damaged where it is compressed";
    let mode = Mode::parse(mode).map_err(|_| BAD)?;
    // This one came later than the library's list.
    let is_colour = filter == "COLOR";
    let filter = if is_colour { Filter::None } else { Filter::parse(filter).map_err(|_| BAD)? };
    let view = BufferView::new(mode, filter, count, stride).map_err(|_| BAD)?;
    if view.byte_length() > bytes.len().saturating_mul(MAX_RATIO) {
        return Err(DAMAGED);
    }
    let mut decoded = view.decode(bytes, &mut Workspace::default()).map_err(|_| DAMAGED)?;
    if is_colour {
        decode_filter_color(&mut decoded, count, stride, &mut Workspace::default()).map_err(|_| BAD)?;
    }
    Ok(decoded)
}
