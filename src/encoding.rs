//! Records to bytes and back: the only place that knows bincode.
//!
//! Layout: bincode 2, little-endian, variable-length integers, the fields of a record in order; `formats/` writes down what
//! each record is, so that bincode can be replaced without a new format. A checksum is the containing file's business.

pub(crate) use bincode::{Decode, Encode};

/// Most that encoding and decoding count, and so the longest record.
pub(crate) const MAX_BYTES: usize = 1 << 30;
/// Upper bound of the memory of a decoded item for each encoded byte. A light without columns is the worst case, with
/// 18 bytes encoded and some 120 in memory.
pub(crate) const MEMORY_PER_BYTE: usize = 8;

/// Encodes a record.
pub(crate) fn encode(record: impl Encode) -> Vec<u8> {
    bincode::encode_to_vec(record, config()).expect("encoding into memory cannot fail")
}

/// Decodes a record from the start of some bytes, and returns how many it used. Allocations are bounded by the bytes at
/// hand.
///
/// A length field makes bincode allocate that many items at once, up to a constant limit. So the limit is chosen from a
/// ladder: a damaged length cannot ask for more than 32 times the bytes at hand, or 4 KiB.
///
/// # Errors
/// As text for the caller to place: the bytes are no such record.
pub(crate) fn decode<T: Decode<()>>(bytes: &[u8]) -> Result<(T, usize), String> {
    macro_rules! first_that_fits {
        ($($limit:expr),*) => {
            $(if bytes.len() * MEMORY_PER_BYTE <= $limit {
                return bincode::decode_from_slice(bytes, config().with_limit::<{ $limit }>()).map_err(|e| e.to_string());
            })*
        };
    }
    first_that_fits!(1 << 12, 1 << 14, 1 << 16, 1 << 18, 1 << 20, 1 << 22, 1 << 24, 1 << 26, 1 << 28);
    bincode::decode_from_slice(bytes, config()).map_err(|e| e.to_string())
}

type Config = bincode::config::Configuration<
    bincode::config::LittleEndian,
    bincode::config::Varint,
    bincode::config::Limit<MAX_BYTES>,
>;

fn config() -> Config {
    bincode::config::standard().with_limit::<MAX_BYTES>()
}
