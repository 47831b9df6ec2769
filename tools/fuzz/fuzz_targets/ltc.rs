//! Any bytes, decoded as a chunk of a `.ltc`; what they stand for is said in `../inputs/ltc.rs`.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../inputs/ltc.rs"]
mod input;

fuzz_target!(|bytes: &[u8]| {
    input::look(bytes);
});
