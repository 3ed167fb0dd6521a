//! A dot product that panics where an index is out of bounds.
#[no_mangle]
pub unsafe extern "C" fn dot(out: *mut f32, a: *const [f32; 4], b: *const [f32; 4]) {
    let (a, b) = (*a, *b);
    let last = std::hint::black_box(4);
    *out = (0..=last).map(|i| a[i] * b[i]).sum();
}
