#!/usr/bin/env bash
# scripts/fuzz.sh MINUTES [TARGET...]: fuzzes the readers of bytes (fuzz/fuzz_targets), all or those named, one on each
# core at a time, for MINUTES in all, and prints a table. Fails where an input crashed a reader, or took more than 2 GB
# or 30 s; the input is then in fuzz/artifacts. Needs cargo-fuzz and a C++ compiler; what was found interesting stays in
# fuzz/corpus, from which the next run starts.
set -euo pipefail
cd "$(dirname "$0")/.."

minutes=${1:?say for how many MINUTES}
shift
if ! command -v cargo-fuzz >/dev/null; then
    echo "fuzz: no cargo-fuzz found; run \`cargo install cargo-fuzz\`" >&2
    exit 1
fi

# Without a sanitizer, which needs an unstable compiler: Rust's own checks panic.
cargo fuzz build --sanitizer none
WRITE_CORPUS="$PWD/fuzz/corpus" cargo test --workspace --exclude tdcr-mujoco --release --locked --test readers corpus
binaries=fuzz/target/$(rustc -vV | sed -n 's/^host: //p')/release

targets=("$@")
[ ${#targets[@]} -gt 0 ] || mapfile -t targets < <(cargo fuzz list)
cores=$(nproc)
seconds=$(awk "BEGIN {print int(60 * $minutes * $cores / ${#targets[@]} + 1)}")
logs=$(mktemp -d)
# Each input is a file of its own for a moment: in memory, where there is such a place.
work=$(mktemp -d -p "$([ -w /dev/shm ] && echo /dev/shm || echo /tmp)")
trap 'rm -rf "$logs" "$work"' EXIT

# One target until its time is over. A crash ends libFuzzer: it is started again, 20 times at most.
run() {
    local target=$1 end=$((SECONDS + seconds)) left
    mkdir -p "fuzz/corpus/$target" "fuzz/artifacts/$target"
    for _ in {1..20}; do
        left=$((end - SECONDS))
        [ "$left" -gt 0 ] || break
        TMPDIR="$work" "$binaries/$target" -max_total_time="$left" -max_len=100000 -timeout=30 -rss_limit_mb=2048 \
            -print_final_stats=1 -artifact_prefix="fuzz/artifacts/$target/" "fuzz/corpus/$target" \
            >>"$logs/$target" 2>&1 || true
    done
}
export -f run
export seconds logs work binaries

rm -rf fuzz/artifacts
printf '%s\n' "${targets[@]}" | xargs -P "$cores" -I{} bash -c 'SECONDS=0; run {}'

crashes=0
printf '%-16s %12s %8s %8s %8s\n' target executions seconds corpus crashes
for target in "${targets[@]}"; do
    executions=$(awk '/stat::number_of_executed_units/ {sum += $2} END {print sum + 0}' "$logs/$target")
    found=$(find "fuzz/artifacts/$target" -type f | wc -l)
    corpus=$(find "fuzz/corpus/$target" -type f | wc -l)
    printf '%-16s %12d %8d %8d %8d\n' "$target" "$executions" "$seconds" "$corpus" "$found"
    crashes=$((crashes + found))
    if [ "$executions" -eq 0 ]; then
        echo "fuzz: $target did not run:" >&2
        tail -n 5 "$logs/$target" >&2
        exit 1
    fi
done
if [ "$crashes" -gt 0 ]; then
    echo "fuzz: $crashes inputs in fuzz/artifacts; \`cargo fuzz run --sanitizer none TARGET FILE\` runs one again" >&2
    exit 1
fi
