//! Functions whose instructions are known, by which the counters show that they count.

/// A function without arguments, and what there is to count in it.
pub struct Known {
    /// Its symbol.
    pub symbol: &'static str,
    code: unsafe extern "sysv64" fn(),
    /// Instructions between its labels `.body` and `.body_end`.
    pub body: u64,
    /// How many of those are executed in a call.
    pub executed: u64,
    /// Instructions that other functions execute in a call.
    pub elsewhere: u64,
}

impl Known {
    /// Calls it.
    pub fn call(&self) {
        // SAFETY: it takes nothing, gives nothing and keeps to the convention; it needs no more than x86-64 has.
        unsafe { (self.code)() }
    }

    /// Where it is.
    pub fn address(&self) -> usize {
        self.code as usize
    }
}

macro_rules! known {
    ($($name:ident: $body:literal, executed $executed:literal, elsewhere $elsewhere:literal;)*) => {
        unsafe extern "sysv64" {
            $(fn $name();)*
        }
        /// All of them. Each has `endbr64` and `ret` around its body.
        pub static KNOWN: &[Known] = &[$(Known {
            symbol: stringify!($name),
            code: $name,
            body: $body,
            executed: $executed,
            elsewhere: $elsewhere,
        }),*];
    };
}

known! {
    rayo_known_0: 0, executed 0, elsewhere 0;
    rayo_known_1: 1, executed 1, elsewhere 0;
    rayo_known_7: 7, executed 7, elsewhere 0;
    rayo_known_1000: 1000, executed 1000, elsewhere 0;
    rayo_known_loop: 3, executed 21, elsewhere 0;
    rayo_known_repeat: 3, executed 3, elsewhere 0;
    rayo_known_call: 2, executed 2, elsewhere 9;
}
