#!/usr/bin/env bash
# run.sh SECONDS [TARGET …]: fuzzes every target, or those named, for so many seconds each.
set -euo pipefail
cd "$(dirname "$0")"
seconds=${1:?seconds per target}
shift
sanitizer=${VLSCAN_FUZZ_SANITIZER:-address}
# The instrumentation is an unstable option of the compiler: of nightly Rust, or of the stable one by this variable.
if rustup toolchain list 2>/dev/null | grep -q '^nightly'; then
  build=(cargo +nightly fuzz build)
else
  export RUSTC_BOOTSTRAP=1
  build=(cargo fuzz build)
fi
"${build[@]}" --fuzz-dir . --sanitizer "$sanitizer" --release readers
program=$(ls -t target/*/release/readers | head -1)
targets=("$@")
[ "${#targets[@]}" -gt 0 ] || mapfile -t targets < <(VLSCAN_FUZZ=? "$program" -runs=0 2>&1 | sed -n 's/.*there are //p' | tr ' ' '\n')
export ASAN_OPTIONS=${ASAN_OPTIONS:-detect_odr_violation=0:detect_leaks=0}
failed=()
for target in "${targets[@]}"; do
  mkdir -p "corpus/$target" "artifacts/$target" "seeds/$target"
  log=artifacts/$target.log
  VLSCAN_FUZZ=$target "$program" -max_total_time="$seconds" -timeout=5 -rss_limit_mb=1024 -max_len=65536 -close_fd_mask=3 \
    -print_final_stats=1 -artifact_prefix="artifacts/$target/" "corpus/$target" "seeds/$target" >"$log" 2>&1 || failed+=("$target")
  printf '%-18s %12s executions%s\n' "$target" "$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")" \
    "$([[ " ${failed[*]:-} " == *" $target "* ]] && echo ", FAILED: $log")"
done
[ "${#failed[@]}" -eq 0 ]
