//! Any bytes, read as a `.ltm`; what they stand for is said in `../inputs/ltm.rs`.
#![no_main]

use libfuzzer_sys::fuzz_target;

#[path = "../inputs/ltm.rs"]
mod input;

fuzz_target!(|bytes: &[u8]| {
    input::look(bytes);
});
