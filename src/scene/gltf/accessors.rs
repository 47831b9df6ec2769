//! Accessors: numbers of every type in buffers, with what sparse ones replace.

use super::buffers::Buffers;
use super::tree::JsonItem;
use crate::error::Result;

/// Elements that lie in a buffer at equal distances.
struct Elements<'a> {
    bytes: &'a [u8],
    stride: usize,
    size: usize,
    count: usize,
}

impl<'a> Elements<'a> {
    fn iter(&self) -> impl Iterator<Item = &'a [u8]> {
        let (bytes, stride, size) = (self.bytes, self.stride, self.size);
        (0..self.count).map(move |i| &bytes[i * stride..i * stride + size])
    }
}

/// Component type of an accessor.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Kind {
    fn of(item: &JsonItem<'_>) -> Result<Self> {
        match item.whole("componentType")? {
            Some(5120) => Ok(Self::I8),
            Some(5121) => Ok(Self::U8),
            Some(5122) => Ok(Self::I16),
            Some(5123) => Ok(Self::U16),
            Some(5125) => Ok(Self::U32),
            Some(5126) => Ok(Self::F32),
            Some(other) => Err(item.refuse("componentType", &format!("{other} is no type of numbers"))),
            None => Err(item.refuse("componentType", "is missing")),
        }
    }

    fn bytes(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }
}

/// An accessor as it is stated.
pub(super) struct Accessor<'a> {
    item: JsonItem<'a>,
    index: usize,
    pub(super) count: usize,
    /// Numbers of an element.
    pub(super) width: usize,
    kind: Kind,
    is_fraction: bool,
    /// What a decoder made of it, instead of what its view has.
    decoded: Option<Vec<f32>>,
}

impl<'a> Accessor<'a> {
    fn size(&self) -> usize {
        self.width * self.kind.bytes()
    }

    /// The same accessor with elements that a decoder produced.
    pub(super) fn with(mut self, numbers: Vec<f32>) -> Self {
        self.count = numbers.len() / self.width;
        self.decoded = Some(numbers);
        self
    }

    /// How many elements the file has bytes for, of which there are `most`.
    pub(super) fn paid(&self, most: usize) -> usize {
        if self.decoded.is_some() { self.count } else { self.count.min(most) }
    }
}

impl<'a> Buffers<'a> {
    /// An accessor by its index. Errors: it is not there, or its types are none.
    pub(super) fn accessor(&self, index: usize) -> Result<Accessor<'a>> {
        let item = self.tree.item("accessors", index)?;
        let width = match item.text("type")? {
            Some("SCALAR") => 1,
            Some("VEC2") => 2,
            Some("VEC3") => 3,
            Some("VEC4" | "MAT2") => 4,
            Some("MAT3") => 9,
            Some("MAT4") => 16,
            _ => return Err(item.refuse("type", "is none that there is")),
        };
        let kind = Kind::of(&item)?;
        let count = item.whole("count")?.ok_or_else(|| item.refuse("count", "is missing"))?;
        let is_fraction = item.flag("normalized")?.unwrap_or(false);
        Ok(Accessor { item, index, count, width, kind, is_fraction, decoded: None })
    }

    /// The elements of `count × size` bytes that `item` states by its view and its offset there.
    fn elements(&self, item: &JsonItem<'_>, count: usize, size: usize, what: &str) -> Result<Elements<'_>> {
        let view = item.index("bufferView", "bufferViews")?.ok_or_else(|| item.refuse("bufferView", "is missing"))?;
        let offset = item.whole("byteOffset")?.unwrap_or(0);
        let whole = self.view(view)?;
        let stride = self.stride(view)?.unwrap_or(size);
        let needed = (count.saturating_sub(1)).checked_mul(stride).and_then(|n| n.checked_add(size));
        let end = needed.and_then(|needed| needed.checked_add(offset));
        match end {
            _ if count == 0 => Ok(Elements { bytes: &[], stride, size, count }),
            Some(end) if end <= whole.len() && stride >= size => {
                Ok(Elements { bytes: &whole[offset..end], stride, size, count })
            }
            _ => Err(self.refuse(format!(
                "{what} has {count} elements of {size} bytes, more than the {} bytes of its buffer view hold",
                whole.len()
            ))),
        }
    }

    /// Bytes of each element of an accessor, its sparse ones replaced.
    fn raw(&self, accessor: &Accessor<'_>) -> Result<Vec<u8>> {
        let (item, count, size) = (&accessor.item, accessor.count, accessor.size());
        let what = format!("accessor {}", accessor.index);
        let mut raw = if item.has("bufferView") {
            let elements = self.elements(item, count, size, &what)?;
            let mut raw = Vec::with_capacity(count * size);
            elements.iter().for_each(|element| raw.extend_from_slice(element));
            raw
        } else if count > self.len() {
            // Zeros, which no byte of the file stands for: as many as there could be.
            return Err(self.refuse(format!("{what} has {count} elements and no data")));
        } else {
            vec![0; count * size]
        };
        let Some(sparse) = item.object("sparse")? else { return Ok(raw) };
        let part = |key: &str| sparse.object(key)?.ok_or_else(|| sparse.refuse(key, "is missing"));
        let (indices, values) = (part("indices")?, part("values")?);
        let replacements = sparse.whole("count")?.ok_or_else(|| sparse.refuse("count", "is missing"))?;
        let places = self.elements(&indices, replacements, Kind::of(&indices)?.bytes(), &what)?;
        let replaced = self.elements(&values, replacements, size, &what)?;
        for (place, value) in places.iter().zip(replaced.iter()) {
            let index = unsigned(place);
            if index >= count {
                return Err(self.refuse(format!("{what} replaces element {index} of {count}")));
            }
            raw[index * size..(index + 1) * size].copy_from_slice(value);
        }
        Ok(raw)
    }

    /// Vectors of `N` numbers; integers are taken as they are, or as fractions of their range if they are normalised. They may
    /// be infinite or no numbers.
    pub(super) fn vectors<const N: usize>(&self, accessor: &Accessor<'_>, what: &str) -> Result<Vec<[f32; N]>> {
        if accessor.width != N {
            return Err(self.refuse(format!("accessor {} has no vectors of {N} numbers for {what}", accessor.index)));
        }
        if let Some(numbers) = &accessor.decoded {
            let number = |v: f32| if accessor.is_fraction { fraction(v, accessor.kind) } else { v };
            return Ok(numbers.as_chunks::<N>().0.iter().map(|vector| vector.map(number)).collect());
        }
        let (kind, width) = (accessor.kind, accessor.kind.bytes());
        let vector =
            |e: &[u8]| std::array::from_fn(|i| number(&e[i * width..(i + 1) * width], kind, accessor.is_fraction));
        Ok(self.raw(accessor)?.chunks_exact(accessor.size()).map(vector).collect())
    }

    /// As [`vectors`](Self::vectors), and all values must be finite.
    pub(super) fn finite<const N: usize>(&self, accessor: &Accessor<'_>, what: &str) -> Result<Vec<[f32; N]>> {
        let vectors = self.vectors(accessor, what)?;
        match vectors.iter().position(|v: &[f32; N]| !v.iter().all(|n| n.is_finite())) {
            Some(at) => Err(self.refuse(format!("accessor {}: {what} {at} is not finite", accessor.index))),
            None => Ok(vectors),
        }
    }

    /// Indices of vertices, each below `vertices`.
    pub(super) fn indices(&self, accessor: &Accessor<'_>, vertices: usize) -> Result<Vec<u32>> {
        if accessor.width != 1 || !matches!(accessor.kind, Kind::U8 | Kind::U16 | Kind::U32) {
            return Err(self.refuse(format!("accessor {} has no indices", accessor.index)));
        }
        let raw = self.raw(accessor)?;
        let indices: Vec<u32> = raw.chunks_exact(accessor.size()).map(|e| unsigned(e) as u32).collect();
        match indices.iter().find(|&&index| index as usize >= vertices) {
            Some(index) => {
                Err(self.refuse(format!("accessor {} asks for vertex {index} of {vertices}", accessor.index)))
            }
            None => Ok(indices),
        }
    }
}

/// A little-endian number of at most four bytes.
fn unsigned(bytes: &[u8]) -> usize {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | usize::from(byte))
}

fn number(bytes: &[u8], kind: Kind, is_fraction: bool) -> f32 {
    let unsigned = unsigned(bytes) as u32;
    let value = match kind {
        Kind::I8 => f32::from(unsigned as u8 as i8),
        Kind::I16 => f32::from(unsigned as u16 as i16),
        Kind::U8 | Kind::U16 | Kind::U32 => unsigned as f32,
        Kind::F32 => f32::from_bits(unsigned),
    };
    if is_fraction { fraction(value, kind) } else { value }
}

/// A number as a fraction of the range of its kind.
fn fraction(value: f32, kind: Kind) -> f32 {
    let largest = match kind {
        Kind::I8 => 127.0,
        Kind::U8 => 255.0,
        Kind::I16 => 32_767.0,
        Kind::U16 => 65_535.0,
        Kind::U32 => 4_294_967_295.0,
        Kind::F32 => return value,
    };
    (value / largest).max(-1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_numbers_or_fractions() {
        assert_eq!(number(&[0x80], Kind::I8, true), -1.0);
        assert_eq!(number(&[0x81], Kind::I8, true), -1.0);
        assert_eq!(number(&[0x81], Kind::I8, false), -127.0);
        assert_eq!(number(&[0xff, 0xff], Kind::U16, true), 1.0);
        assert_eq!(number(&[0x00, 0x01], Kind::U16, false), 256.0);
        assert_eq!(number(&[0x00, 0x80], Kind::I16, false), -32_768.0);
        assert_eq!(number(&1.5f32.to_le_bytes(), Kind::F32, false), 1.5);
    }
}
