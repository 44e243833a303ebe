"""Counts lines of Rust by folder: code is what is neither blank nor comment.

Tests, benches and examples are left out.

    python3 docs/dev/size.py [FOLDER OF THE REPOSITORY]
"""

import collections
import pathlib
import re
import sys

LEFT_OUT = {"target", "tests", "benches", "examples", "fuzz", "node_modules"}
TEST_FILE = re.compile(r"(.+_)?tests|testkit|testing|fixture")
TEST_MODULE = re.compile(r"#\[cfg\(test\)\]\n(pub(\(\w+\))? )?mod \w+ \{")


def code_lines(text: str) -> int:
    module = TEST_MODULE.search(text)
    lines = (line.strip() for line in text[: module.start() if module else None].split("\n"))
    return sum(bool(line) and not line.startswith("//") for line in lines)


def main() -> None:
    root = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else ".")
    sizes: collections.Counter[str] = collections.Counter()
    for path in sorted(root.rglob("*.rs")):
        parts = path.relative_to(root).parts
        if LEFT_OUT.isdisjoint(parts) and not TEST_FILE.fullmatch(path.stem):
            depth = 2 if parts[0] in ("crates", "apps", "python") else 1
            sizes["/".join(parts[:-1][:depth])] += code_lines(path.read_text(encoding="utf-8"))
    for folder, size in sizes.items():
        print(f"{size:7}  {folder}")
    print(f"{sum(size for folder, size in sizes.items() if folder.startswith('crates/')):7}  crates")
    print(f"{sum(sizes.values()):7}  all")


if __name__ == "__main__":
    main()
