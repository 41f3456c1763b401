"""Call every public function, class and method with one wrong argument at a time.

``python tests/wrong_inputs`` makes a fifth of all calls, about 9000, and writes ``table.csv``. ``--share 1`` makes all
of them; another ``--seed`` chooses others. A call must return, or raise HexakinError, within 10 s. TypeError is right
only where Python itself refuses the call. Everything else is printed, and the exit code is then 1. The calls are made
in processes of their own (``worker.py``), because a wrong argument may end a process or never return.
"""

import argparse
import collections
import csv
import json
import queue
import random
import subprocess
import sys
import threading
from pathlib import Path

HERE = Path(__file__).resolve().parent
SHARE = 0.2
PATIENCE = 10.0  # [s] for one call
STARTUP = 600.0  # [s] for loading the package and making the examples, compilation included
RIGHT = ("result", "error", "refused by Python")
WRONG = ("raw error", "over 10 s", "process died")


class Worker:
    """A process that makes one call after another."""

    def __init__(self):
        command = [sys.executable, "-W", "ignore", str(HERE / "worker.py")]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.answers = queue.Queue()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self):
        for line in self.process.stdout:
            self.answers.put(json.loads(line))
        self.answers.put(None)

    def ask(self, question, patience):
        """Return the answer; None if the process died, and "late" if there is no answer in ``patience`` seconds."""
        try:
            self.process.stdin.write(json.dumps(question) + "\n")
            self.process.stdin.flush()
            return self.answers.get(timeout=patience)
        except queue.Empty:
            return "late"
        except OSError:
            return None

    def end(self):
        self.process.kill()
        self.process.wait()


def run(calls, jobs):
    """Make all calls, and return the outcome and its text for each."""
    waiting, found = collections.deque(calls), {}

    def work():
        worker = None
        while waiting:
            try:
                call = waiting.popleft()
            except IndexError:
                break
            if worker is None:
                worker = Worker()
                worker.ask(None, STARTUP)
            answer = worker.ask(call, PATIENCE)
            if answer in (None, "late"):
                found[tuple(call)] = ("process died", "") if answer is None else ("over 10 s", "")
                worker.end()
                worker = None
            else:
                found[tuple(call)] = tuple(answer)
        if worker is not None:
            worker.end()

    threads = [threading.Thread(target=work) for _ in range(jobs)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return found


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--share", type=float, default=SHARE, help="share of the calls that are made")
    parser.add_argument("--seed", type=int, default=0, help="chooses the share")
    parser.add_argument("--jobs", type=int, default=2, help="number of processes")
    parser.add_argument("--only", default="", help="only callables whose name contains this text")
    parser.add_argument("--list", action="store_true", help="print every call with its outcome")
    options = parser.parse_args()
    first = Worker()
    calls = [call for call in first.ask("calls", STARTUP) if options.only in call[0]]
    first.end()
    chosen = sorted(random.Random(options.seed).sample(calls, round(options.share * len(calls))))
    found = run(chosen, options.jobs)
    for call, (outcome, text) in sorted(found.items()):
        if options.list or outcome in WRONG:
            print(*call, outcome, text, sep=" | ")
    if options.share >= SHARE and not options.only:
        write(found)
    counts = collections.Counter(outcome for outcome, _ in found.values())
    print(f"{len(found)} calls of {len({call[0] for call in found})} public callables:", end=" ")
    print(", ".join(f"{counts[outcome]} {outcome}" for outcome in (*RIGHT, *WRONG)))
    return int(any(counts[outcome] for outcome in WRONG))


def write(found):
    """Write the number of calls with each outcome, by callable and argument."""
    rows = collections.defaultdict(collections.Counter)
    for (name, parameter, _), (outcome, _) in found.items():
        rows[name, parameter][outcome] += 1
    with open(HERE / "table.csv", "w", newline="", encoding="utf-8") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["callable", "argument", *RIGHT, *WRONG])
        for (name, parameter), counts in sorted(rows.items()):
            table.writerow([name, parameter, *(counts[outcome] for outcome in (*RIGHT, *WRONG))])


if __name__ == "__main__":
    sys.exit(main())
