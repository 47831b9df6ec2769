//! Accessors: numbers of every type in buffers, with what sparse ones replace.

use gltf::Accessor;
use gltf::accessor::{DataType, sparse};
use gltf::buffer::View;

use super::buffers::Buffers;
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

impl Buffers {
    /// The elements of `count × size` bytes at an offset of a view.
    fn elements(&self, view: &View<'_>, offset: usize, count: usize, size: usize, what: &str) -> Result<Elements<'_>> {
        let whole = self.view(view)?;
        let stride = view.stride().unwrap_or(size);
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
        let (count, size) = (accessor.count(), accessor.size());
        let what = format!("accessor {}", accessor.index());
        let mut raw = match accessor.view() {
            Some(view) => {
                let elements = self.elements(&view, accessor.offset(), count, size, &what)?;
                let mut raw = Vec::with_capacity(count * size);
                elements.iter().for_each(|element| raw.extend_from_slice(element));
                raw
            }
            // Zeros, which no byte of the file stands for: as many as there could be.
            None if count > self.len() => {
                return Err(self.refuse(format!("{what} has {count} elements and no data")));
            }
            None => vec![0; count * size],
        };
        let Some(sparse) = accessor.sparse() else { return Ok(raw) };
        let (indices, values) = (sparse.indices(), sparse.values());
        let width = match indices.index_type() {
            sparse::IndexType::U8 => 1,
            sparse::IndexType::U16 => 2,
            sparse::IndexType::U32 => 4,
        };
        let places = self.elements(&indices.view(), indices.offset(), sparse.count(), width, &what)?;
        let replaced = self.elements(&values.view(), values.offset(), sparse.count(), size, &what)?;
        for (place, value) in places.iter().zip(replaced.iter()) {
            let index = unsigned(place);
            if index >= count {
                return Err(self.refuse(format!("{what} replaces element {index} of {count}")));
            }
            raw[index * size..(index + 1) * size].copy_from_slice(value);
        }
        Ok(raw)
    }

    /// Vectors of `N` numbers; integers are taken as they are, or as fractions of their range if they are normalised.
    pub(super) fn vectors<const N: usize>(&self, accessor: &Accessor<'_>, what: &str) -> Result<Vec<[f32; N]>> {
        if accessor.dimensions().multiplicity() != N {
            return Err(self.refuse(format!("accessor {} has no vectors of {N} numbers for {what}", accessor.index())));
        }
        let (kind, fraction) = (accessor.data_type(), accessor.normalized());
        let raw = self.raw(accessor)?;
        let width = accessor.size() / N;
        let vectors: Vec<[f32; N]> = raw
            .chunks_exact(accessor.size())
            .map(|e| std::array::from_fn(|i| number(&e[i * width..(i + 1) * width], kind, fraction)))
            .collect();
        match vectors.iter().position(|v| !v.iter().all(|n| n.is_finite())) {
            Some(at) => Err(self.refuse(format!("accessor {}: {what} {at} is not finite", accessor.index()))),
            None => Ok(vectors),
        }
    }

    /// Indices of vertices, each below `vertices`.
    pub(super) fn indices(&self, accessor: &Accessor<'_>, vertices: usize) -> Result<Vec<u32>> {
        let whole = matches!(accessor.data_type(), DataType::U8 | DataType::U16 | DataType::U32);
        if accessor.dimensions().multiplicity() != 1 || !whole {
            return Err(self.refuse(format!("accessor {} has no indices", accessor.index())));
        }
        let raw = self.raw(accessor)?;
        let indices: Vec<u32> = raw.chunks_exact(accessor.size()).map(|e| unsigned(e) as u32).collect();
        match indices.iter().find(|&&index| index as usize >= vertices) {
            Some(index) => {
                Err(self.refuse(format!("accessor {} asks for vertex {index} of {vertices}", accessor.index())))
            }
            None => Ok(indices),
        }
    }
}

/// A little-endian number of at most four bytes.
fn unsigned(bytes: &[u8]) -> usize {
    bytes.iter().rev().fold(0, |value, &byte| value << 8 | usize::from(byte))
}

fn number(bytes: &[u8], kind: DataType, fraction: bool) -> f32 {
    let unsigned = unsigned(bytes) as u32;
    let (value, largest) = match kind {
        DataType::I8 => (f32::from(unsigned as u8 as i8), 127.0),
        DataType::U8 => (unsigned as f32, 255.0),
        DataType::I16 => (f32::from(unsigned as u16 as i16), 32_767.0),
        DataType::U16 => (unsigned as f32, 65_535.0),
        DataType::U32 => (unsigned as f32, 4_294_967_295.0),
        DataType::F32 => return f32::from_bits(unsigned),
    };
    if fraction { (value / largest).max(-1.0) } else { value }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn integers_are_numbers_or_fractions() {
        assert_eq!(number(&[0x80], DataType::I8, true), -1.0);
        assert_eq!(number(&[0x81], DataType::I8, true), -1.0);
        assert_eq!(number(&[0x81], DataType::I8, false), -127.0);
        assert_eq!(number(&[0xff, 0xff], DataType::U16, true), 1.0);
        assert_eq!(number(&[0x00, 0x01], DataType::U16, false), 256.0);
        assert_eq!(number(&[0x00, 0x80], DataType::I16, false), -32_768.0);
        assert_eq!(number(&1.5f32.to_le_bytes(), DataType::F32, false), 1.5);
    }
}
