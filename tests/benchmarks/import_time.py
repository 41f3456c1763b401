"""Time ``import hexakin`` against ``import numpy``: fresh interpreters in turn, medians and the ratio.

Run with ``python tests/benchmarks/import_time.py [repeats]``. Each time is
that of the import alone, measured inside the process.
"""

import statistics
import subprocess
import sys

SCRIPT = "import time; start = time.perf_counter(); import {}; print(time.perf_counter() - start)"


def seconds(module: str) -> float:
    """Import time [s] of a module in a fresh interpreter."""
    return float(subprocess.run([sys.executable, "-c", SCRIPT.format(module)], capture_output=True, check=True).stdout)


def main() -> None:
    """Print both medians and the median of the paired ratios."""
    repeats = int(sys.argv[1]) if len(sys.argv) > 1 else 15
    pairs = [(seconds("hexakin"), seconds("numpy")) for _ in range(repeats + 1)][1:]
    ours, numpy = (statistics.median(column) for column in zip(*pairs, strict=True))
    ratio = statistics.median(a / b for a, b in pairs)
    print(f"import hexakin {1e3 * ours:.1f} ms, import numpy {1e3 * numpy:.1f} ms, ratio {ratio:.3f} ({repeats} pairs)")


if __name__ == "__main__":
    main()
