"""What it costs that Ctrl-C ends a batch: pieces with a look at signals against one call, alternating, one thread.

python benchmarks/interruptible.py
"""

import argparse
import time
from functools import partial

import numpy as np

from rollingjoint import five_link, set_threads, small_arm, threads
from rollingjoint.chain.batch import PinnedRange
from rollingjoint.statics.batch import prescribed


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeats", type=int, default=40)
    repeats = parser.parse_args().repeats
    set_threads(1)
    for chain, rows in ((five_link(), 100_000), (small_arm(), 10_000)):
        work = PinnedRange(chain.kernels, _batch(chain, rows))
        work(0, rows)
        calls = partial(work, 0, rows), partial(threads.run_in_threads, work, rows, chain.n_joints)
        seconds = np.empty((repeats, 2))
        for repeat in range(repeats):
            for which in (0, 1) if repeat % 2 else (1, 0):
                seconds[repeat, which] = _seconds(calls[which])
        once, ratio = seconds[:, 0], np.median(seconds[:, 1] / seconds[:, 0])
        print(
            f"{chain.name}: {rows:,} rows, {np.median(once) / rows * 1e6:.2f} µs a row, pieces take {ratio:.3f} of it"
        )


def _batch(chain, rows):
    tensions = np.random.default_rng(0).uniform(0.5, 10.0, (rows, chain.n_tendons))
    starts = np.repeat(chain.neutral_angles[None], rows, axis=0)
    tables = np.zeros((rows, 0, len(chain.load_columns)))
    results = chain.kernels.new_results(rows, chain.n_joints, chain.n_tendons)
    designs = np.zeros(rows, np.int64)
    return chain.kernels.batch_arrays(chain.arrays, designs, prescribed(tensions), tables, starts, results)


def _seconds(call):
    begin = time.process_time()
    call()
    return time.process_time() - begin


if __name__ == "__main__":
    main()
