"""Mutation run over the safety code of the core: every small change of it should make a test fail.

Each mutant is one change of one file. It is compiled, linked with the other files' objects and run until the first
test that fails; a run that takes too long counts as failed. Mutants that cannot be told apart from the original are
listed in mutants_equivalent.txt, each with the reason, and are neither run nor counted.

Usage: mutate.py [--jobs N] [--every N] [--list] [FILE...]
Exits with 1 when fewer than 90 % are killed.
"""

from __future__ import annotations

import argparse
import os
import re
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path

HERE = Path(__file__).resolve().parent
CORE = HERE / "core"
TESTS = HERE / "tests"
GENERATED = HERE / "build" / "generated"
EQUIVALENT = HERE / "mutants_equivalent.txt"
FILES = ("motion_limits", "machine", "latches", "faults", "supply", "hinges", "config")
NEEDED = 0.9
LONGEST_RUN_S = 10.0

# What is undefined ends a mutant as a failed test would.
UNDEFINED = ["-fsanitize=undefined", "-fsanitize-undefined-trap-on-error"]
FLAGS = ["-std=c11", "-w", *UNDEFINED, f"-I{CORE}", f"-I{TESTS}", "-isystem", str(GENERATED)]
ONCE, MUTANT = "-O2", "-O0"
"""What is compiled once has to run fast, what is run once has to compile fast."""

TOKEN = re.compile(
    r"""
    (?P<skip>/\*.*?\*/|//[^\n]*|"(?:\\.|[^"\\])*"|'(?:\\.|[^'\\])*'|\\\n|_Static_assert\(.*?\);)
    |(?P<directive>^\#[^\n]*)
    |(?P<number>\b(?:0[xX][0-9a-fA-F]+|\d+)(?P<suffix>[uUlL]*)\b)
    |(?P<name>[A-Za-z_]\w*)
    |(?P<operator><<=|>>=|->|\+\+|--|<<|>>|<=|>=|==|!=|&&|\|\||[-+*/%&|^]=|[-+*/%&|^~!<>=?:;,.(){}\[\]])
    """,
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)

SWAPS: dict[str, tuple[str, ...]] = {
    "<": ("<=", ">="),
    "<=": ("<", ">"),
    ">": (">=", "<="),
    ">=": (">", "<"),
    "==": ("!=",),
    "!=": ("==",),
    "&&": ("||",),
    "||": ("&&",),
    "+": ("-",),
    "-": ("+",),
    "*": ("/",),
    "/": ("*",),
    "%": ("/",),
    "<<": (">>",),
    ">>": ("<<",),
    "&": ("|",),
    "|": ("&",),
    "^": ("|",),
    "+=": ("-=",),
    "-=": ("+=",),
    "|=": ("&=",),
    "&=": ("|=",),
    "++": ("--",),
    "--": ("++",),
}
"""Binary operators and what takes their place."""

INSTEAD = {
    "true": "false",
    "false": "true",
    "ORI_ACCEPTED": "ORI_REFUSED_STATE",
    "ORI_FAULT_NONE": "ORI_FAULT_INTERNAL",
}
"""Names and what takes their place; a result or a fault becomes none."""

TYPES = re.compile(r"^(const|static|extern|typedef|struct|enum|bool|u?int\d+_t|knot_t|verdict_t|\w+_t)\b")
KEYWORDS = {"if", "for", "while", "switch", "return", "case", "default", "else", "do", "sizeof"}


@dataclass(frozen=True)
class Token:
    """One token and where it is."""

    kind: str
    text: str
    start: int
    end: int


@dataclass(frozen=True)
class Mutant:
    """One change: the text from `start` to `end` becomes `new`."""

    file: str
    line: int
    code: str
    start: int
    end: int
    old: str
    new: str
    function: str
    which: int
    """Of the places in the function that read the same: 1 for the first."""

    @property
    def key(self) -> str:
        """What names it in the list of equivalent ones, wherever the line moves to."""
        place = f" ({self.which})" if self.which > 1 else ""
        return f"{self.file}.c {self.function} | {self.code} | {self.old} -> {self.new or 'nothing'}{place}"


def tokens_of(text: str) -> list[Token]:
    """What may be changed: no comments, texts and static assertions; of directives, the numbers they define."""
    found: list[Token] = []
    for match in TOKEN.finditer(text):
        kind = match.lastgroup or ""
        kind = "number" if kind == "suffix" else kind
        if kind == "directive":
            found += _defined(match.group(), match.start())
        elif kind != "skip":
            found.append(Token(kind, match.group(), match.start(), match.end()))
    return found


def _defined(directive: str, offset: int) -> Iterator[Token]:
    """The numbers of a #define of one value."""
    value = re.match(r"#define\s+\w+\s+(.*?)(?:/\*.*)?$", directive)
    for match in re.finditer(r"\b(?:0x[0-9a-fA-F]+|\d+)(?=[UL]*\b)", value.group(1) if value else ""):
        assert value is not None
        start = offset + value.start(1) + match.start()
        yield Token("number", match.group(), start, start + len(match.group()))


class Mutator:
    """Finds the mutants of one file."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.text = (CORE / f"{file}.c").read_text()
        self.tokens = tokens_of(self.text)

    def mutants(self) -> list[Mutant]:
        """All of them, in order of place, none twice, and numbered where several of a function read the same."""
        found = {(m.start, m.end, m.new): m for m in self._all()}
        seen: Counter[str] = Counter()
        mutants = []
        for key in sorted(found):
            seen[found[key].key] += 1
            mutants.append(replace(found[key], which=seen[found[key].key]))
        return mutants

    def _all(self) -> Iterator[Mutant]:
        for i, token in enumerate(self.tokens):
            yield from self._of_token(i, token)
        yield from self._conditions()
        yield from self._statements()

    def _make(self, start: int, end: int, new: str) -> Mutant:
        line = self.text.count("\n", 0, start) + 1
        code = self.text.splitlines()[line - 1].strip()
        old = " ".join(self.text[start:end].split())
        begun = re.findall(r"^\w[^;=\n]*?(\w+)\([^;\n]*$", self.text[:start], flags=re.MULTILINE)
        function = begun[-1] if begun else "-"
        return Mutant(self.file, line, code, start, end, old, " ".join(new.split()), function, 1)

    def _of_token(self, i: int, token: Token) -> Iterator[Mutant]:
        if token.kind == "number":
            yield from self._of_number(token)
        elif token.kind == "name":
            yield from self._of_name(i, token)
        elif token.text == "!":
            yield self._make(token.start, token.end, "")
        elif token.text == "?":
            yield self._make(token.start, token.end, "&& 0 ?")
            yield self._make(token.start, token.end, "|| 1 ?")
        elif self._is_binary(i):
            for new in SWAPS.get(token.text, ()):
                yield self._make(token.start, token.end, new)

    def _of_number(self, token: Token) -> Iterator[Mutant]:
        digits = re.match(r"0[xX][0-9a-fA-F]+|\d+", token.text)
        assert digits is not None
        value, suffix = int(digits.group(), 0), token.text[digits.end() :]
        yield self._make(token.start, token.end, f"{value + 1}{suffix}")
        if value > 0:
            yield self._make(token.start, token.end, f"{value - 1}{suffix}")

    def _of_name(self, i: int, token: Token) -> Iterator[Mutant]:
        case = i > 0 and self.tokens[i - 1].text in ("case", "[")  # labels and designators are no values
        if token.text in INSTEAD and not case:
            yield self._make(token.start, token.end, INSTEAD[token.text])
        elif token.text.startswith("ORI_REFUSED_"):
            yield self._make(token.start, token.end, "ORI_ACCEPTED")
        elif token.text.startswith("ORI_FAULT_") and not case:
            yield self._make(token.start, token.end, "ORI_FAULT_NONE")

    def _is_binary(self, i: int) -> bool:
        """Whether an operator has a value on its left; a declared pointer's star and an address have none."""
        token, before = self.tokens[i], self.tokens[i - 1] if i else None
        if token.text in ("++", "--"):
            return True
        if before is None or (before.kind == "name" and (before.text in KEYWORDS or before.text.endswith("_t"))):
            return False
        if before.text == ")" and token.text in ("*", "&", "-", "+"):
            return not self._closes_a_cast(i - 1)
        return before.kind in ("name", "number") or before.text in (")", "]")

    def _closes_a_cast(self, i: int) -> bool:
        """Whether the parenthesis that ends here is around a type."""
        opened = self._opening(i)
        inside = [t.text for t in self.tokens[opened + 1 : i]]
        return bool(inside) and all(t.endswith("_t") or t in ("const", "*", "bool", "unsigned") for t in inside)

    def _opening(self, i: int) -> int:
        depth = 0
        while True:
            depth += {")": 1, "(": -1}.get(self.tokens[i].text, 0)
            if depth == 0:
                return i
            i -= 1

    def _closing(self, i: int) -> int:
        depth = 0
        while True:
            depth += {"(": 1, ")": -1}.get(self.tokens[i].text, 0)
            if depth == 0:
                return i
            i += 1

    def _conditions(self) -> Iterator[Mutant]:
        """Negate what `if` and `while` ask, unless swapping its one operator or dropping its `!` does so anyway."""
        for i, token in enumerate(self.tokens):
            if token.text not in ("if", "while") or self.tokens[i + 1].text != "(":
                continue
            closing = self._closing(i + 1)
            inside = [t.text for t in self.tokens[i + 2 : closing]]
            if inside[0] != "!" and not ({"<", "<=", ">", ">=", "==", "!="} & set(inside)):
                start, end = self.tokens[i + 1].start, self.tokens[closing].end
                yield self._make(start, end, f"(!{self.text[start:end]})")

    def _statements(self) -> Iterator[Mutant]:
        """Leave a statement out, or return something else."""
        begin = 0
        depth = braces = 0
        for i, token in enumerate(self.tokens):
            depth += {"(": 1, ")": -1}.get(token.text, 0)
            braces += {"{": 1, "}": -1}.get(token.text, 0)
            if depth or token.text not in (";", "{", "}", ":"):
                continue
            if token.text == ";" and braces > 0:
                yield from self._of_statement(self._after_heads(begin, i), i)
            begin = i + 1

    def _after_heads(self, begin: int, end: int) -> int:
        """Skip `if (...)`, `else`, `for (...)` and `while (...)` before a statement."""
        while begin < end and self.tokens[begin].text in ("if", "else", "for", "while"):
            begin = begin + 1 if self.tokens[begin].text == "else" else self._closing(begin + 1) + 1
        return begin

    def _of_statement(self, begin: int, end: int) -> Iterator[Mutant]:
        if begin >= end:
            return
        start, stop = self.tokens[begin].start, self.tokens[end].start
        statement = self.text[start:stop]
        if statement.startswith("return ") and end - begin > 2:  # a single value is changed as what it is
            yield self._make(start, stop, f"return !({statement.removeprefix('return ')})")
        elif not statement.startswith("return ") and not TYPES.match(statement):
            yield self._make(start, stop, "")


class Bench:
    """Compiles and runs mutants in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.objects: dict[str, Path] = {}

    def build(self, jobs: int) -> None:
        """Compile everything once."""
        sources = sorted(CORE.glob("*.c")) + sorted(TESTS.glob("*.c"))
        with ThreadPoolExecutor(jobs) as pool:
            for source, made in zip(sources, pool.map(self._compile, sources), strict=True):
                self.objects[f"{source.parent.name}/{source.stem}"] = made
        program = self.folder / "unit"
        self._link(program, self.objects)
        began = time.monotonic()
        if self._run(program, FILES[0]) is None:
            raise SystemExit("error: the tests fail without any mutation; run make test")
        print(f"the tests take {time.monotonic() - began:.2f} s", flush=True)

    def _compile(self, source: Path) -> Path:
        made = self.folder / f"{source.parent.name}_{source.stem}.o"
        subprocess.run(["gcc", *FLAGS, ONCE, "-c", str(source), "-o", str(made)], check=True)
        return made

    def _link(self, program: Path, objects: dict[str, Path]) -> None:
        subprocess.run(["gcc", *map(str, objects.values()), "-lm", "-o", str(program)], check=True)

    def _run(self, program: Path, suite: str) -> str | None:
        """None when a test failed."""
        try:
            done = subprocess.run([str(program), "--first", suite], capture_output=True, timeout=LONGEST_RUN_S)
        except subprocess.TimeoutExpired:
            return None
        return "passed" if done.returncode == 0 else None

    def verdict(self, mutant: Mutant, text: str, number: int) -> str:
        """killed, survived, or stillborn when it is no program."""
        stem = self.folder / f"mutant{number}"
        source, made, program = stem.with_suffix(".c"), stem.with_suffix(".o"), stem.with_suffix("")
        source.write_text(text[: mutant.start] + mutant.new + text[mutant.end :])
        try:
            compiled = subprocess.run(
                ["gcc", *FLAGS, MUTANT, "-c", str(source), "-o", str(made)], capture_output=True
            )
            if compiled.returncode != 0:
                return "stillborn"
            self._link(program, {**self.objects, f"core/{mutant.file}": made})
            return "survived" if self._run(program, mutant.file) else "killed"
        finally:
            for left in (source, made, program):
                left.unlink(missing_ok=True)


def equivalents() -> dict[str, str]:
    """Keys of mutants that no test can tell apart, and why."""
    found: dict[str, str] = {}
    if not EQUIVALENT.exists():
        return found
    key = ""
    for line in EQUIVALENT.read_text().splitlines():
        if line.startswith("    "):
            found[key] = f"{found.get(key, '')} {line.strip()}".strip()
        elif line and not line.startswith("#"):
            key = line.strip()
            found[key] = ""
    without = [key for key, reason in found.items() if not reason]
    if without:
        raise SystemExit("error: equivalent mutants without a reason:\n" + "\n".join(without))
    return found


def run(files: list[str], jobs: int, every: int) -> int:
    """Run the files' mutants, or one of `every`, and tell."""
    known = equivalents()
    used: set[str] = set()
    killed = total = 0
    survivors: list[Mutant] = []
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(jobs) as pool:
        bench = Bench(Path(folder))
        bench.build(jobs)
        for file in files:
            mutator = Mutator(file)
            mutants = [m for m in mutator.mutants() if m.key not in known][::every]
            used |= {m.key for m in mutator.mutants()} & known.keys()
            verdicts = list(pool.map(lambda p, t=mutator.text: bench.verdict(p[1], t, p[0]), enumerate(mutants)))
            mine = verdicts.count("killed")
            count = mine + verdicts.count("survived")
            survivors += [m for m, v in zip(mutants, verdicts, strict=True) if v == "survived"]
            stillborn = verdicts.count("stillborn")
            print(f"{file + '.c':16} {mine:4} of {count:4} killed, {stillborn} stillborn", flush=True)
            killed, total = killed + mine, total + count
    for mutant in survivors:
        print(f"survived {mutant.file}.c:{mutant.line}\n    {mutant.key}")
    stale = {key for key in known if key.split(".c ")[0] in files} - used  # the code has moved on
    for key in sorted(stale):
        print(f"listed as equivalent, but no mutant any more: {key}")
    share = killed / total if total else 1.0
    print(f"{killed} of {total} mutants killed, {100 * share:.1f} %; {len(used)} are equivalent")
    return int(share < NEEDED)


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description="Mutation run over the firmware's safety code.")
    parser.add_argument("files", nargs="*", default=list(FILES), metavar="FILE")
    parser.add_argument("--jobs", type=int, default=min(2, os.cpu_count() or 1))
    parser.add_argument("--every", type=int, default=1, metavar="N", help="run one mutant of N, the first of each N")
    parser.add_argument("--list", action="store_true", help="tell the mutants and run none")
    arguments = parser.parse_args()
    files = [Path(name).stem for name in arguments.files]
    if arguments.list:
        for file in files:
            for mutant in Mutator(file).mutants():
                print(f"{mutant.file}.c:{mutant.line} {mutant.key}")
        return 0
    return run(files, arguments.jobs, max(1, arguments.every))


if __name__ == "__main__":
    sys.exit(main())
