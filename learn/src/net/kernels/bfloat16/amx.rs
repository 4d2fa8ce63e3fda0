//! Products of tiles on Intel's matrix unit (AMX): Intel's Software Developer's Manual, volume 1, chapter 18.
#![allow(
    unsafe_code,
    reason = "the matrix unit's instructions are to be had by inline assembly alone: their intrinsics are unstable"
)]

use std::arch::asm;
use std::arch::x86_64::__cpuid_count;
use std::marker::PhantomData;
use std::sync::OnceLock;

use faer::Accum;

use super::panel::Panel;
use super::tile::SIDE;
use super::unit::{Four, Order, Shape, Term, Unit};

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

/// The unit, ready for products on this thread: tile registers are a thread's own, so it cannot be sent to another.
pub struct Amx(PhantomData<*const ()>);

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

impl Amx {
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
        Self(PhantomData)
    }
}

impl Unit for Amx {
    /// # Panics
    /// Where `c` is too short or two matrices differ in their inner dimension.
    fn multiply(&self, terms: &[Term], four: Four, accum: Accum, c: &mut [f32], stride: usize) {
        let Four {
            first,
            shape,
            order,
        } = four;
        let [rows, columns] = shape.tiles();
        assert!(stride >= columns * SIDE && c.len() >= (rows * SIDE - 1) * stride + columns * SIDE);
        let start = c.as_mut_ptr();
        let c: [_; 4] = std::array::from_fn(|tile| {
            start.wrapping_add((tile / columns * stride + tile % columns) * SIDE)
        });
        let stride = stride * size_of::<f32>();
        // SAFETY: the tile registers are set up, as `self` shows, and nothing else uses them before `self` is dropped. Of
        // `c`, 16 rows of 16 floats are read from and written to each of the four tiles, which lie within it.
        unsafe {
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
                    "tileloadd tmm0, [{c0} + {stride}*1]",
                    "tileloadd tmm1, [{c1} + {stride}*1]",
                    "tileloadd tmm2, [{c2} + {stride}*1]",
                    "tileloadd tmm3, [{c3} + {stride}*1]",
                    c0 = in(reg) c[0],
                    c1 = in(reg) c[1],
                    c2 = in(reg) c[2],
                    c3 = in(reg) c[3],
                    stride = in(reg) stride,
                    out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                    options(nostack, readonly),
                ),
            }
        }
        for term in terms {
            match shape {
                Shape::Square if order == Order::AlongColumns => {
                    self.add_streaming(term, first, c[2].wrapping_byte_add(SIDE * stride), stride);
                }
                Shape::Square => self.add_square(term, first),
                Shape::Tall => {
                    let Term { left, right } = term;
                    self.add_strip([left, right], first, Strip::Tall);
                }
                Shape::Wide => {
                    let Term { left, right } = term;
                    self.add_strip([right, left], [first[1], first[0]], Strip::Wide);
                }
            }
        }
        // SAFETY: as above.
        unsafe {
            asm!(
                "tilestored [{c0} + {stride}*1], tmm0",
                "tilestored [{c1} + {stride}*1], tmm1",
                "tilestored [{c2} + {stride}*1], tmm2",
                "tilestored [{c3} + {stride}*1], tmm3",
                c0 = in(reg) c[0],
                c1 = in(reg) c[1],
                c2 = in(reg) c[2],
                c3 = in(reg) c[3],
                stride = in(reg) stride,
                options(nostack),
            );
        }
    }
}

impl Amx {
    /// Adds two tiles by two to the first four registers.
    fn add_square(&self, Term { left, right }: &Term, first: [usize; 2]) {
        assert_eq!(left.depth(), right.depth(), "one inner dimension");
        // SAFETY: the tile registers are set up, as `self` shows. Of each operand tiles of 16 lines of 64 bytes are read at
        // its strides, as many as it has.
        unsafe {
            asm!(
                "2:",
                "tileloadd tmm4, [{left0} + {left_line}*1]",
                "tileloadd tmm6, [{right0} + {right_line}*1]",
                "tdpbf16ps tmm0, tmm4, tmm6",
                "tileloadd tmm7, [{right1} + {right_line}*1]",
                "tdpbf16ps tmm1, tmm4, tmm7",
                "tileloadd tmm5, [{left1} + {left_line}*1]",
                "tdpbf16ps tmm2, tmm5, tmm6",
                "tdpbf16ps tmm3, tmm5, tmm7",
                "add {left0}, {left_step}",
                "add {left1}, {left_step}",
                "add {right0}, {right_step}",
                "add {right1}, {right_step}",
                "dec {depth}",
                "jnz 2b",
                left0 = inout(reg) left.pointer(first[0]) => _,
                left1 = inout(reg) left.pointer(first[0] + 1) => _,
                right0 = inout(reg) right.pointer(first[1]) => _,
                right1 = inout(reg) right.pointer(first[1] + 1) => _,
                left_line = in(reg) left.strides().line * size_of::<u16>(),
                right_line = in(reg) right.strides().line * size_of::<u16>(),
                left_step = in(reg) left.strides().inner * size_of::<u16>(),
                right_step = in(reg) right.strides().inner * size_of::<u16>(),
                depth = inout(reg) left.depth() => _,
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack, readonly),
            );
        }
    }

    /// As [`Amx::add_square`], where the left matrix streams by: its tiles are loaded so that they displace no others from
    /// the first cache, and `next`, the rows of the output that follow, is fetched meanwhile.
    fn add_streaming(
        &self,
        Term { left, right }: &Term,
        first: [usize; 2],
        next: *const f32,
        stride: usize,
    ) {
        assert_eq!(left.depth(), right.depth(), "one inner dimension");
        // SAFETY: as for squares. Fetching is no access: it may be beyond the output's end.
        unsafe {
            asm!(
                "2:",
                "tileloaddt1 tmm4, [{left0} + {left_line}*1]",
                "tileloadd tmm6, [{right0} + {right_line}*1]",
                "tdpbf16ps tmm0, tmm4, tmm6",
                "tileloadd tmm7, [{right1} + {right_line}*1]",
                "tdpbf16ps tmm1, tmm4, tmm7",
                "tileloaddt1 tmm5, [{left1} + {left_line}*1]",
                "tdpbf16ps tmm2, tmm5, tmm6",
                "tdpbf16ps tmm3, tmm5, tmm7",
                "prefetchw [{next}]",
                "prefetchw [{next} + 64]",
                "prefetchw [{next} + {stride}*1]",
                "prefetchw [{next} + {stride}*1 + 64]",
                "lea {next}, [{next} + {stride}*2]",
                "add {left0}, {left_step}",
                "add {left1}, {left_step}",
                "add {right0}, {right_step}",
                "add {right1}, {right_step}",
                "dec {depth}",
                "jnz 2b",
                next = inout(reg) next => _,
                stride = in(reg) stride,
                left0 = inout(reg) left.pointer(first[0]) => _,
                left1 = inout(reg) left.pointer(first[0] + 1) => _,
                right0 = inout(reg) right.pointer(first[1]) => _,
                right1 = inout(reg) right.pointer(first[1] + 1) => _,
                left_line = in(reg) left.strides().line * size_of::<u16>(),
                right_line = in(reg) right.strides().line * size_of::<u16>(),
                left_step = in(reg) left.strides().inner * size_of::<u16>(),
                right_step = in(reg) right.strides().inner * size_of::<u16>(),
                depth = inout(reg) left.depth() => _,
                out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                out("tmm4") _, out("tmm5") _, out("tmm6") _, out("tmm7") _,
                options(nostack, readonly),
            );
        }
    }

    /// Adds four tiles of the first panel, from block `first[0]` on, by one of the second to the first four registers.
    fn add_strip(&self, [four, one]: [&Panel; 2], first: [usize; 2], strip: Strip) {
        assert_eq!(four.depth(), one.depth(), "one inner dimension");
        /// The loop, with the operands of each product in the order given.
        macro_rules! strip {
            ($($register:literal $product:literal),*) => {
                // SAFETY: the tile registers are set up, as `self` shows. Of each operand tiles of 16 lines of 64 bytes are
                // read at its strides, as many as it has.
                unsafe {
                    asm!(
                        "2:",
                        "tileloadd tmm4, [{one} + {line}*1]",
                        $(
                            concat!("tileloadd tmm5, [{four", $register, "} + {four_line}*1]"),
                            concat!("tdpbf16ps tmm", $register, ", ", $product),
                            concat!("add {four", $register, "}, {four_step}"),
                        )*
                        "add {one}, {step}",
                        "dec {depth}",
                        "jnz 2b",
                        four0 = inout(reg) four.pointer(first[0]) => _,
                        four1 = inout(reg) four.pointer(first[0] + 1) => _,
                        four2 = inout(reg) four.pointer(first[0] + 2) => _,
                        four3 = inout(reg) four.pointer(first[0] + 3) => _,
                        one = inout(reg) one.pointer(first[1]) => _,
                        four_line = in(reg) four.strides().line * size_of::<u16>(),
                        line = in(reg) one.strides().line * size_of::<u16>(),
                        four_step = in(reg) four.strides().inner * size_of::<u16>(),
                        step = in(reg) one.strides().inner * size_of::<u16>(),
                        depth = inout(reg) four.depth() => _,
                        out("tmm0") _, out("tmm1") _, out("tmm2") _, out("tmm3") _,
                        out("tmm4") _, out("tmm5") _,
                        options(nostack, readonly),
                    );
                }
            };
        }
        match strip {
            Strip::Tall => {
                strip!("0" "tmm5, tmm4", "1" "tmm5, tmm4", "2" "tmm5, tmm4", "3" "tmm5, tmm4");
            }
            Strip::Wide => {
                strip!("0" "tmm4, tmm5", "1" "tmm4, tmm5", "2" "tmm4, tmm5", "3" "tmm4, tmm5");
            }
        }
    }
}

/// Which panel of a strip has four tiles: the left one or the right one.
#[derive(Clone, Copy)]
enum Strip {
    Tall,
    Wide,
}

impl Drop for Amx {
    /// Empties the tile registers, so that the system need not save them.
    fn drop(&mut self) {
        // SAFETY: the unit is there, as `self` shows.
        unsafe { asm!("tilerelease", options(nostack, nomem)) }
    }
}
