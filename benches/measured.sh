# For the scripts beside it: `measured PROGRAM …` runs a program and says how much memory and time it took. Without GNU time and
# Python the time alone is told.
measured() {
    if [ -x /usr/bin/time ]; then
        /usr/bin/time -f "  peak memory %M kB, %e s, %U s of computing" "$@"
    elif command -v python3 > /dev/null; then
        python3 - "$@" << 'PYTHON'
import resource, subprocess, sys, time
start = time.time()
status = subprocess.call(sys.argv[1:])
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(f"  peak memory {used.ru_maxrss} kB, {time.time() - start:.1f} s, {used.ru_utime:.1f} s of computing", file=sys.stderr)
sys.exit(status)
PYTHON
    else
        time "$@"
    fi
}
