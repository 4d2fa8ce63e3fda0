//! The most that this machine's vector units multiply and add, on one thread and on all: the floor under every product of the
//! networks.
//!
//!     cargo bench --bench peak
//!
//! prints GFLOP/s in float32 and, where there is a unit for it, in bfloat16, of a loop of independent multiply-adds that touches no
//! memory. Needs AVX-512; Intel's matrix unit is not measured.

#![allow(clippy::print_stdout, reason = "its figures are its output")]

#[cfg(target_arch = "x86_64")]
fn main() {
    use units::{bfloat16, float32};
    let all = std::thread::available_parallelism().map_or(1, |threads| threads.get());
    let mut rows = Vec::new();
    if is_x86_feature_detected!("avx512f") {
        rows.push(("float32", float32 as fn(u64), 32.0));
    }
    if is_x86_feature_detected!("avx512bf16") {
        rows.push(("bfloat16", bfloat16 as fn(u64), 64.0));
    }
    if rows.is_empty() {
        println!("measures AVX-512, which this processor does not have");
    }
    for (name, product, flops) in rows {
        for threads in [1, all] {
            let rate = rate(product, flops, threads);
            println!("{name:8} {threads:3} threads {rate:7.0} GFLOP/s");
        }
    }
}

#[cfg(not(target_arch = "x86_64"))]
fn main() {
    println!("measures AVX-512 alone");
}

/// GFLOP/s of `threads` threads that run `product`, whose every instruction does `flops`.
#[cfg(target_arch = "x86_64")]
fn rate(product: fn(u64), flops: f64, threads: usize) -> f64 {
    const ROUNDS: u64 = 200_000_000;
    let start = std::time::Instant::now();
    std::thread::scope(|scope| {
        for _ in 0..threads {
            scope.spawn(|| product(ROUNDS));
        }
    });
    threads as f64 * (ROUNDS * units::REGISTERS) as f64 * flops
        / start.elapsed().as_secs_f64()
        / 1e9
}

#[cfg(target_arch = "x86_64")]
#[allow(
    unsafe_code,
    reason = "what the processor can do is measured instruction by instruction"
)]
mod units {
    use std::arch::asm;

    /// Registers that sums go to in turn: enough that none waits for the one before it.
    pub const REGISTERS: u64 = 12;

    macro_rules! product {
        ($name:ident, $instruction:literal, $what:literal) => {
            #[doc = $what]
            pub fn $name(rounds: u64) {
                // SAFETY: called where the processor was found to have the instruction; all registers are declared, and no
                // memory is touched.
                unsafe {
                    asm!(
                        "2:",
                        concat!($instruction, " zmm0, zmm30, zmm31"),
                        concat!($instruction, " zmm1, zmm30, zmm31"),
                        concat!($instruction, " zmm2, zmm30, zmm31"),
                        concat!($instruction, " zmm3, zmm30, zmm31"),
                        concat!($instruction, " zmm4, zmm30, zmm31"),
                        concat!($instruction, " zmm5, zmm30, zmm31"),
                        concat!($instruction, " zmm6, zmm30, zmm31"),
                        concat!($instruction, " zmm7, zmm30, zmm31"),
                        concat!($instruction, " zmm8, zmm30, zmm31"),
                        concat!($instruction, " zmm9, zmm30, zmm31"),
                        concat!($instruction, " zmm10, zmm30, zmm31"),
                        concat!($instruction, " zmm11, zmm30, zmm31"),
                        "dec {rounds}",
                        "jnz 2b",
                        rounds = inout(reg) rounds => _,
                        out("zmm0") _, out("zmm1") _, out("zmm2") _, out("zmm3") _,
                        out("zmm4") _, out("zmm5") _, out("zmm6") _, out("zmm7") _,
                        out("zmm8") _, out("zmm9") _, out("zmm10") _, out("zmm11") _,
                        options(nomem, nostack),
                    );
                }
            }
        };
    }

    product!(
        float32,
        "vfmadd231ps",
        "16 products of float32 and as many sums an instruction."
    );
    product!(
        bfloat16,
        "vdpbf16ps",
        "32 products of bfloat16 and as many sums an instruction."
    );
}
