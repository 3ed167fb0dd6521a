//! The paper's C as small functions that take vectors by value, at each optimisation level. They
//! serve only to be counted.

use super::isa::psabi_level;
use super::types::{Light, PaperSphere, PaperTriangle, Vec4};

/// A ray as in the paper's C.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Ray {
    /// r_o.
    pub origin: Vec4,
    /// r_d.
    pub direction: Vec4,
}

macro_rules! by_value {
    ($list:tt $($level:literal)*) => {
        by_value!(@table $list);
        static LEVELS: &[ByValue] = &[$(
            #[cfg(all(rayo_asm, rayo_c))]
            by_value!(@level $level $list),
        )*];
    };
    (@table {$($(#[$doc:meta])* fn $name:ident($($arg:ident: $type:ty),*) -> $out:ty;)*}) => {
        /// The functions compiled at one optimisation level.
        pub struct ByValue {
            /// The level as build.rs names it: O0, O1, O2, O3, or native for -O3 -march=native.
            pub level: &'static str,
            needs: &'static u32,
            $($name: convention!(type($($type),*) -> $out),)*
        }

        impl ByValue {
            /// The address of a function, by the name of its operation.
            pub fn address(&self, name: &str) -> Option<usize> {
                match name {
                    $(stringify!($name) => Some(self.$name as usize),)*
                    _ => None,
                }
            }

            $($(#[$doc])*
            #[inline]
            pub fn $name(&self, $($arg: $type),*) -> $out {
                // SAFETY: the arguments are values, and references that prove their addresses;
                // by_value() has checked the CPU.
                unsafe { (self.$name)($($arg),*) }
            })*
        }
    };
    (@level $level:literal {$($(#[$doc:meta])* fn $name:ident($($arg:ident: $type:ty),*) -> $out:ty;)*}) => {{
        convention! { foreign {
            #[link_name = concat!("rayo_c_", $level, "_needs")]
            safe static NEEDS: u32;
            $(#[link_name = concat!("rayo_c_", $level, "_", stringify!($name))]
            fn $name($($arg: $type),*) -> $out;)*
        } }
        ByValue { level: $level, needs: &NEEDS, $($name,)* }
    }};
}

by_value! {
    {
        /// a + b.
        fn add(a: Vec4, b: Vec4) -> Vec4;
        /// a - b.
        fn sub(a: Vec4, b: Vec4) -> Vec4;
        /// a times the scalar s.
        fn scale(a: Vec4, s: f32) -> Vec4;
        /// a . b.
        fn dot(a: Vec4, b: Vec4) -> f32;
        /// ||a||.
        fn norm(a: Vec4) -> f32;
        /// a x b.
        fn cross(a: Vec4, b: Vec4) -> Vec4;
        /// a / ||a||.
        fn normalise(a: Vec4) -> Vec4;
        /// Whether the ray meets the sphere, and at which t.
        fn sphere(ray: Ray, sphere: &PaperSphere, t: &mut f32) -> bool;
        /// Whether the ray meets the triangle, and at which t.
        fn triangle(ray: Ray, triangle: &PaperTriangle, t: &mut f32) -> bool;
        /// The light that `light` adds at a point with this normal.
        fn lambert(light: &Light, point: Vec4, normal: Vec4, colour: Vec4, two_sided: bool) -> Vec4;
    }
    "O0" "O1" "O2" "O3" "native"
}

/// The functions compiled at a level. None if the CPU lacks the instructions that they were
/// compiled for, or if this build does not have the level.
pub fn by_value(level: &str) -> Option<&'static ByValue> {
    let functions = LEVELS.iter().find(|functions| functions.level == level)?;
    (*functions.needs <= psabi_level()).then_some(functions)
}
