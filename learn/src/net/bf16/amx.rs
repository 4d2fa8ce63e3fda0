//! Products of tiles on Intel's matrix unit (AMX): Intel's Software Developer's Manual, volume 1, chapter 18.
#![allow(
    unsafe_code,
    reason = "the matrix unit's instructions are to be had by inline assembly alone: their intrinsics are unstable"
)]

use std::arch::asm;
use std::arch::x86_64::__cpuid_count;
use std::sync::OnceLock;

use faer::Accum;

use super::product::Block;
use super::tile::SIDE;

/// Whether the processor has the unit, with bfloat16 products, and the system lets this process use it.
///
/// The first call asks for that; a process may use the unit in all its threads from then on.
pub fn is_available() -> bool {
    static AVAILABLE: OnceLock<bool> = OnceLock::new();
    *AVAILABLE.get_or_init(|| is_present() && request())
}

/// CPUID, leaf 7: bits 22 (AMX-BF16) and 24 (AMX-TILE) of EDX.
fn is_present() -> bool {
    const NEEDED: u32 = 1 << 22 | 1 << 24;
    let leaves = __cpuid_count(0, 0).eax;
    leaves >= 7 && __cpuid_count(7, 0).edx & NEEDED == NEEDED
}

/// Asks Linux for the tiles' state (`arch_prctl(ARCH_REQ_XCOMP_PERM, XFEATURE_XTILEDATA)`).
#[cfg(target_os = "linux")]
fn request() -> bool {
    const ARCH_PRCTL: i64 = 158;
    const ARCH_REQ_XCOMP_PERM: u64 = 0x1023;
    const XFEATURE_XTILEDATA: u64 = 18;
    let result: i64;
    // SAFETY: this system call takes two numbers and touches no memory of ours; the kernel overwrites rcx and r11.
    unsafe {
        asm!(
            "syscall",
            inlateout("rax") ARCH_PRCTL => result,
            in("rdi") ARCH_REQ_XCOMP_PERM,
            in("rsi") XFEATURE_XTILEDATA,
            out("rcx") _,
            out("r11") _,
            options(nostack),
        );
    }
    result == 0
}

#[cfg(not(target_os = "linux"))]
fn request() -> bool {
    false
}

/// The unit, ready for products on this thread.
pub struct Unit(());

/// Shape of the tile registers (palette 1): each of the eight has 16 rows of 64 bytes.
#[repr(C, align(64))]
struct Palette([u8; 64]);

impl Palette {
    const FULL: Self = {
        let mut bytes = [0; 64];
        bytes[0] = 1;
        let mut register = 0;
        while register < 8 {
            bytes[16 + 2 * register] = 64;
            bytes[48 + register] = SIDE as u8;
            register += 1;
        }
        Self(bytes)
    };
}

impl Unit {
    /// Sets up this thread's tile registers.
    ///
    /// # Panics
    /// Where the unit is not available.
    pub fn new() -> Self {
        assert!(is_available(), "a processor with AMX");
        static PALETTE: Palette = Palette::FULL;
        // SAFETY: the unit is there and this process may use it; the operand is a valid palette of 64 bytes.
        unsafe {
            asm!(
                "ldtilecfg [{}]",
                in(reg) &raw const PALETTE,
                options(nostack, readonly),
            );
        }
        Self(())
    }

    /// Puts the product of two tiles by two, along the inner dimension, into the 32 x 32 floats of `c`, whose rows are
    /// `stride` numbers apart, or adds it.
    pub fn multiply_tiles(&self, block: &Block, accum: Accum, c: &mut [f32], stride: usize) {
        let Block { left, right } = block;
        let depth = left[0].len();
        assert!(
            depth > 0
                && [left[1], right[0], right[1]]
                    .iter()
                    .all(|row| row.len() == depth)
        );
        assert!(stride >= 2 * SIDE && c.len() >= (2 * SIDE - 1) * stride + 2 * SIDE);
        let upper = c.as_mut_ptr();
        // SAFETY: the tile registers are set up, as `self` shows, and nothing else uses them before `self` is dropped. Of
        // each operand `depth` tiles of 1024 bytes are read, as many as it has; of `c`, 32 rows of 32 floats are read and
        // written, which lie within it.
        unsafe {
            let lower = upper.add(SIDE * stride);
            let stride = stride * size_of::<f32>();
            match accum {
                Accum::Replace => asm!(
                    "tilezero tmm0",
                    "tilezero tmm1",
                    "tilezero tmm2",
                    "tilezero tmm3",
                    out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                    options(nostack, nomem),
                ),
                Accum::Add => asm!(
                    "tileloadd tmm0, [{upper} + {stride}*1]",
                    "tileloadd tmm1, [{upper} + {stride}*1 + 64]",
                    "tileloadd tmm2, [{lower} + {stride}*1]",
                    "tileloadd tmm3, [{lower} + {stride}*1 + 64]",
                    upper = in(reg) upper,
                    lower = in(reg) lower,
                    stride = in(reg) stride,
                    out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                    options(nostack, readonly),
                ),
            }
            asm!(
                "2:",
                "tileloaddt1 tmm4, [{left0} + {line}*1]",
                "tileloadd tmm6, [{right0} + {line}*1]",
                "tdpbf16ps tmm0, tmm4, tmm6",
                "tileloadd tmm7, [{right1} + {line}*1]",
                "tdpbf16ps tmm1, tmm4, tmm7",
                "tileloaddt1 tmm5, [{left1} + {line}*1]",
                "tdpbf16ps tmm2, tmm5, tmm6",
                "tdpbf16ps tmm3, tmm5, tmm7",
                "prefetchw [{next}]",
                "prefetchw [{next} + 64]",
                "prefetchw [{next} + {stride}*1]",
                "prefetchw [{next} + {stride}*1 + 64]",
                "lea {next}, [{next} + {stride}*2]",
                "prefetchw [{next}]",
                "prefetchw [{next} + 64]",
                "prefetchw [{next} + {stride}*1]",
                "prefetchw [{next} + {stride}*1 + 64]",
                "lea {next}, [{next} + {stride}*2]",
                "add {left0}, 1024",
                "add {left1}, 1024",
                "add {right0}, 1024",
                "add {right1}, 1024",
                "dec {depth}",
                "jnz 2b",
                "tilestored [{upper} + {stride}*1], tmm0",
                "tilestored [{upper} + {stride}*1 + 64], tmm1",
                "tilestored [{lower} + {stride}*1], tmm2",
                "tilestored [{lower} + {stride}*1 + 64], tmm3",
                upper = in(reg) upper,
                lower = in(reg) lower,
                stride = in(reg) stride,
                next = inout(reg) upper.wrapping_add(2 * SIDE * stride / 4) => _,
                left0 = inout(reg) left[0].as_ptr() => _,
                left1 = inout(reg) left[1].as_ptr() => _,
                right0 = inout(reg) right[0].as_ptr() => _,
                right1 = inout(reg) right[1].as_ptr() => _,
                line = in(reg) 64usize,
                depth = inout(reg) depth => _,
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack),
            );
        }
    }
}

impl Drop for Unit {
    /// Empties the tile registers, so that the system need not save them.
    fn drop(&mut self) {
        // SAFETY: the unit is there, as `self` shows.
        unsafe { asm!("tilerelease", options(nostack, nomem)) }
    }
}
