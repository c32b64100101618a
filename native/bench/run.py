# SPDX-License-Identifier: GPL-3.0-or-later
"""Benchmarks of the core: how fast it is, and by how much two commits differ.

    python native/bench/run.py [--out FILE.json] [--only WORDS] [--rounds N]
    python native/bench/run.py --against COMMIT [--out ...] [--only ...] [--rounds ...]
    python native/bench/run.py --compare BEFORE.json AFTER.json [--only ...]

The first measures this checkout's core, the second also that of a commit, which it builds in a
temporary worktree; both run in turns, so that a slow moment of the machine hits both. Times are
processor time of one thread; a ratio is the time after by the time before, above 1 is slower.
--only takes words of the names of benchmarks, and alternatives with commas between:
`--only 128 surface,cell`.
"""

from __future__ import annotations

import argparse
import signal
import sys
from contextlib import ExitStack, closing
from pathlib import Path

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import build_core
from bench import results
from bench.libraries import BenchError, Library, checkout, find_commit, own_commit, say
from bench.results import Result

ROUNDS = 7
SIGNALS = {signal.SIGINT: "interrupted", signal.SIGTERM: "terminated", signal.SIGHUP: "hung up"}


class Signalled(BaseException):
    """A signal, raised so that worktree and processes are taken away."""


def chosen(names: list[str], words: list[str]) -> list[str]:
    """The names that hold each of the words, of alternatives one. Raises BenchError."""
    known = list(dict.fromkeys(word for name in names for word in name.split()))
    asked = [set(word.split(",")) for word in words]
    unknown = sorted(set().union(*asked) - set(known))
    if unknown:
        raise BenchError(
            f"no benchmark has {', '.join(map(repr, unknown))} in its name; "
            f"the words are {', '.join(known)}"
        )
    found = [name for name in names if all(each & set(name.split()) for each in asked)]
    if not found:
        raise BenchError(f"no benchmark has all of {' '.join(words)} in its name")
    return found


def measure(libraries: list[Library], names: list[str], rounds: int) -> list[Result]:
    """A result for each library, the rounds of all benchmarks and libraries interleaved."""
    found = [results.empty_result(library.name) for library in libraries]
    seconds: list[dict[str, list[float]]] = [{name: [] for name in names} for _ in libraries]
    for turn in range(-1, rounds):  # one more, which sets up
        names = [name for name in names if not any(name in each.left_out for each in found)]
        part = "set-up" if turn < 0 else f"round {turn + 1} of {rounds}"
        say(f"{part}, benchmarks: {len(names)}")
        order = range(len(libraries))
        for name in names:
            for k in reversed(order) if turn % 2 else order:
                took, reason = libraries[k].run(name)
                if reason:
                    found[k].left_out[name] = reason
                elif turn >= 0:
                    seconds[k][name].append(took)
    names = [name for name in names if not any(name in each.left_out for each in found)]
    for library, result, taken in zip(libraries, found, seconds, strict=True):
        for name in names:
            result.benchmarks[name] = results.measured(library.rays[name], taken[name])
    return found


def run_benchmarks(args: argparse.Namespace) -> None:
    """Measure this core, or also that of a commit; prints the table."""
    commit = args.against and find_commit(args.against)
    build_core.build(say=say)
    with ExitStack() as stack:
        libraries = [stack.enter_context(closing(Library(own_commit(), build_core.NATIVE)))]
        if commit:
            chosen(list(libraries[0].rays), args.only)  # before a minute of compiling
            say(f"building the core of {commit}")
            package = stack.enter_context(checkout(commit))
            libraries.append(stack.enter_context(closing(Library(commit, package))))
        names = list(dict.fromkeys(name for library in libraries for name in library.rays))
        found = measure(libraries, chosen(names, args.only), args.rounds)
    if args.out:
        found[0].write(args.out)
    tell(found, paired=True)


def compare_files(args: argparse.Namespace) -> None:
    """Compare two results of earlier runs; prints the table."""
    old, new = found = [results.read(path) for path in args.compare]
    names = chosen(list(dict.fromkeys((*old.benchmarks, *new.benchmarks))), args.only)
    for each in found:
        each.benchmarks = {name: each.benchmarks[name] for name in names if name in each.benchmarks}
        each.left_out = {}
    if old.machine != new.machine:
        say(f"the machines differ: {old.machine}; {new.machine}")
    tell([new, old], paired=False)


def tell(found: list[Result], paired: bool) -> None:
    """Print the table of one result or of two, new and old, and name what was left out."""
    for sentence in results.left_out(found):
        say(sentence)
    if len(found) == 1:
        print(results.table(found[0]))
        return
    new, old = found
    rows = results.compared(new, old, paired)
    print(f"after: {new.commit}\nbefore: {old.commit}\n\n{rows}")


def arguments(words: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--against", metavar="COMMIT", help="build and measure this commit as well")
    what.add_argument("--compare", nargs=2, type=Path, metavar=("BEFORE", "AFTER"))
    parser.add_argument("--out", type=Path, metavar="FILE.json", help="write what was measured")
    parser.add_argument("--only", nargs="+", default=[], metavar="WORD", help="in their names")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help=f"default: {ROUNDS}")
    args = parser.parse_args(words)
    if args.rounds < 1:
        parser.error(f"--rounds must be 1 or more; it is {args.rounds}")
    if args.out and not args.out.absolute().parent.is_dir():
        parser.error(f"--out: there is no folder {args.out.absolute().parent}")
    return args


def end(number, _frame) -> None:
    for each in SIGNALS:
        signal.signal(each, signal.SIG_IGN)  # until all is taken away
    raise Signalled(number)


def main(words: list[str] | None = None) -> int:
    """Run the command; returns its exit status."""
    args = arguments(words)
    try:
        compare_files(args) if args.compare else run_benchmarks(args)
        return 0
    except (BenchError, build_core.BuildError) as error:
        say(str(error))
        return 1
    except Signalled as signalled:
        number = signalled.args[0]
        say(SIGNALS[number])
        return 128 + number


if __name__ == "__main__":
    for listened in SIGNALS:
        if signal.getsignal(listened) is not signal.SIG_IGN:
            signal.signal(listened, end)
    sys.exit(main())
