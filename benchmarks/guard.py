"""Compare what two checkouts answer, and how fast, on one machine in one run.

    python benchmarks/guard.py --before HEAD~1                # this checkout against a git revision, every section
    python benchmarks/guard.py --before ../old --after ../new --only solves episodes
    python benchmarks/guard.py --before HEAD --quick          # every kind of row with tiny sizes: does it still run?

Every checkout runs in processes of its own, in this Python environment, and is asked by public names alone; the guard
draws the inputs. Planar solves and episodes are compared to the bit, arms to 1e-7 in mm and N, means of policies to
1 %, timings as ratios. A row that differs fails, unless `benchmarks/guard_allowed.yaml` lists it with its old value and
the reason (guard_rows/compare.py has the keys). Exit code 0: nothing differs that is not allowed; else 1.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path

from guard_rows.checkout import REPOSITORY, Checkout, checked_out, run_sides
from guard_rows.compare import Allowances, Result, compare
from guard_rows.drawing import FULL, QUICK, Sizes, inputs_of
from guard_rows.record import read_folder
from guard_rows.timings import speed_results, startup_results

COMPARED = ("solves", "episodes", "names", "files")  # the sections of records; the other two are timings
SECTIONS = (*COMPARED, "speed", "startup")
SHOWN, WIDTH = 3, 400  # fields of a row, and characters of what was asked; --out has all
ALLOWED = Path(__file__).resolve().parent / "guard_allowed.yaml"


def main(argv: Sequence[str] | None = None) -> int:
    """Compare, and return the exit code."""
    arguments = _arguments(argv)
    sizes = (QUICK if arguments.quick else FULL)._replace(**({"pairs": arguments.pairs} if arguments.pairs else {}))
    sizes = sizes._replace(**({} if arguments.warmups is None else {"warmups": arguments.warmups}))
    allowed = Allowances(arguments.allowed)
    results: list[Result] = []
    with ExitStack() as stack:
        scratch = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="guard-")))
        sides = []
        for name in ("before", "after"):
            folder = stack.enter_context(checked_out(name, getattr(arguments, name), scratch))
            sides.append(Checkout(name, folder, None if arguments.users_cache else scratch / f"kernels-{name}"))
        for section in arguments.only:
            begin = time.perf_counter()
            for result in _results(section, sides, scratch, sizes, allowed, arguments.quick):
                results.append(result)
                _report(_line(result))
            _report(f"{section}: {time.perf_counter() - begin:.0f} s")
    unused = allowed.unused({result.row for result in results})
    summary = _summary(results, unused)
    print(summary)
    if arguments.out:
        _write(arguments.out, results, summary, [arguments.before, arguments.after])
    return 0 if all(result.ok for result in results) else 1


def _results(
    section: str, sides: list[Checkout], scratch: Path, sizes: Sizes, allowed: Allowances, quick: bool
) -> Iterator[Result]:
    if section == "speed":
        yield from speed_results(sides, sizes, allowed)
    elif section == "startup":
        yield from startup_results(sides, sizes, allowed)
    else:
        before, after = map(read_folder, run_sides(sides, section, scratch, quick))
        for row in dict.fromkeys([*before, *after]):
            result = compare(row, before.get(row), after.get(row))
            allowed.apply(result)
            if section == "solves" and not result.ok:
                first = result.differences[0]
                result.inputs = inputs_of(first.case, first.place[0] if first.place else 0, sizes)
            yield result


def _line(result: Result) -> str:
    """A row of the table."""
    verdict = ("allowed" if result.differences else "ok") if result.ok else "DIFFERS"
    lines = [f"{verdict:8} {result.row:60} {result.figure or result.sample}"]
    lines += [f"         {one}" for one in result.differences[:SHOWN]]
    if (more := len(result.differences) - SHOWN) > 0:
        lines.append(f"         and {more} more fields, which --out writes")
    if result.inputs:
        lines.append(f"         asked: {result.inputs[:WIDTH]}{' ...' if len(result.inputs) > WIDTH else ''}")
    return "\n".join(lines)


def _summary(results: Sequence[Result], unused: Sequence[str]) -> str:
    bad = [result for result in results if not result.ok]
    lines = [_line(result) for result in results if result.differences]
    lines += [f"listed, but differs no longer: {one}" for one in unused]
    lines.append(f"{len(results)} rows, {len(bad)} of them differ" if bad else f"{len(results)} rows, none differs")
    return "\n".join(lines)


def _write(path: Path, results: Sequence[Result], summary: str, sides: Sequence[str]) -> None:
    """The report: JSON, or Markdown for a name that ends so."""
    if path.suffix == ".md":
        rows = [f"| {one.row} | {one.figure or one.sample} | {_verdict(one)} |" for one in results]
        head = f"# {sides[0]} and {sides[1]}\n\n| row | sample or ratio | verdict |\n|---|---|---|\n"
        path.write_text(head + "\n".join(rows) + f"\n\n```text\n{summary}\n```\n", "utf-8")
    else:
        path.write_text(json.dumps([asdict(one) | {"ok": one.ok} for one in results], indent=1, default=str), "utf-8")


def _verdict(result: Result) -> str:
    return "; ".join(map(str, result.differences)) or "same"


def _report(line: str) -> None:
    print(line, file=sys.stderr, flush=True)


def _arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--before", required=True, metavar="PATH_OR_REV", help="the older checkout, or a git revision")
    parser.add_argument("--after", default=str(REPOSITORY), metavar="PATH_OR_REV", help="default: this checkout")
    parser.add_argument(
        "--only", nargs="+", choices=SECTIONS, default=SECTIONS, metavar="NAME", help=", ".join(SECTIONS)
    )
    parser.add_argument("--quick", action="store_true", help="tiny sizes: a test that every kind of row is compared")
    parser.add_argument("--pairs", type=int, help=f"pairs of every speed row (default {FULL.pairs})")
    parser.add_argument("--warmups", type=int, help=f"pairs of whole warm-ups (default {FULL.warmups}; 0: none)")
    parser.add_argument("--allowed", type=Path, default=ALLOWED, metavar="FILE", help="the list of allowed differences")
    parser.add_argument("--users-cache", action="store_true", help="kernels in the user's cache, not compiled anew")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write all rows here: JSON, or Markdown (.md)")
    return parser.parse_args(argv)


if __name__ == "__main__":
    sys.exit(main())
