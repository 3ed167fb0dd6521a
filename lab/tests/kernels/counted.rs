//! Counted code does the same to memory as uncounted code.

#![allow(unsafe_code)]

use std::arch::asm;

use rayo::internals::kernels::step::count_instructions;

/// Fills `$count` elements by `rep $stos` under the instruction counter; returns the number of
/// instructions and the memory around the elements.
macro_rules! filled {
    ($stos:literal, $bytes:literal, $direction:literal, $count:expr) => {{
        let mut memory = [0x55_u8; 64];
        let count: usize = $count;
        let first = if $direction == "std" { 16 + $bytes * count.saturating_sub(1) } else { 16 };
        let out = memory[first..].as_mut_ptr();
        let instructions = count_instructions(|| {
            // SAFETY: the elements are within `memory`; the direction flag is cleared before the
            // compiler's code.
            unsafe {
                asm!($direction, concat!("rep ", $stos), "cld",
                    inout("rcx") count => _, inout("rdi") out => _, in("rax") 0x0807_0605_0403_0201_u64);
            }
        });
        (instructions.unwrap(), memory)
    }};
}

#[test]
fn repeated_store_counts_as_one_and_stores_all() {
    let (once, _) = filled!("stosb", 1, "cld", 1);
    for count in 0..6 {
        for (bytes, [(up, filled_up), (down, filled_down)]) in [
            (1, [filled!("stosb", 1, "cld", count), filled!("stosb", 1, "std", count)]),
            (2, [filled!("stosw", 2, "cld", count), filled!("stosw", 2, "std", count)]),
            (4, [filled!("stosd", 4, "cld", count), filled!("stosd", 4, "std", count)]),
            (8, [filled!("stosq", 8, "cld", count), filled!("stosq", 8, "std", count)]),
        ] {
            let mut expected = [0x55; 64];
            for (index, byte) in expected[16..16 + bytes * count].iter_mut().enumerate() {
                *byte = (index % bytes) as u8 + 1;
            }
            assert_eq!(filled_up, expected, "{count} elements of {bytes} bytes");
            assert_eq!(filled_down, expected, "{count} elements of {bytes} bytes, downwards");
            assert_eq!((up, down), (once, once), "{count} elements of {bytes} bytes");
        }
    }
}
