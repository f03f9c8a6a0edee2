#![no_main]

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| plywave_fuzz::targets::twin_cloth(bytes));
