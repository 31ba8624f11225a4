#![no_main]

#[path = "../../core/tests/common/targets.rs"]
#[allow(dead_code)]
mod targets;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| targets::draw_anything(bytes));
