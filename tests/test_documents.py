"""README and docs refer only to existing commits, files and headings, and the site lists every page."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml

from tests.prerequisites import WHOLE_HISTORY

ROOT = Path(__file__).parents[1]
DOCUMENTS = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md"), ROOT / "web/README.md"])
EVIDENCE = [
    *DOCUMENTS,
    ROOT / "CITATION.cff",
    *sorted([*ROOT.glob("benchmarks/**/*.py"), *ROOT.glob("experiments/*.toml")]),
]
"""Texts that name the commits of measurements."""


def commits_in(text: str) -> set[str]:
    """Find commits: 7 to 40 hexadecimal digits; unless after "commit" or in back-quotes, no words or round numbers."""
    named = re.findall(r"(?:\bcommit |`)([0-9a-f]{7,40})(?![\w.])", text, re.IGNORECASE)
    words = re.findall(r"(?<![\w./-])[0-9a-f]{7,40}(?!\w)", text)
    return {*named, *(each for each in words if re.search(r"\d", each) and not re.fullmatch(r"\d+0000", each))}


def history() -> list[str]:
    """The hashes of all commits up to HEAD."""
    WHOLE_HISTORY.require()
    return git("rev-list", "HEAD").split()


def git(*arguments: str) -> str:
    return subprocess.run(["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=True).stdout.strip()


def anchors(document: Path) -> set[str]:
    """The fragments that GitHub and the site give a document's headings."""
    headings = re.findall(r"^#+ (.+)$", document.read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_a_commit_is_told_from_other_numbers() -> None:
    text = "at 99f8e04 | 4801556, 6 | (99f8e0479908) --count 13000000, 0.28209479, 542,104, title-7e99442b62a2, effaced"
    assert commits_in(text) == {"99f8e04", "4801556", "99f8e0479908"}
    assert commits_in("Commit decaffe; `effaced`, `1000000`") == {"decaffe", "effaced", "1000000"}


def test_figures_were_measured_at_commits_of_this_history() -> None:
    commits = history()
    named = {(str(path.relative_to(ROOT)), each) for path in EVIDENCE for each in commits_in(path.read_text("utf-8"))}
    assert named, "no document names a commit"
    missing = {(path, each) for path, each in named if not any(commit.startswith(each) for commit in commits)}
    assert not missing, "these commits are not in the history"


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_and_cited_files_exist(document: Path) -> None:
    text = document.read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)\s]+)\)", text) if not re.match(r"https?:", link)]
    cited = re.findall(r"`((?:docs|tests)/[\w/.-]+)`", text) if document.parent.name != "results" else []
    broken = [path for path in cited if not (ROOT / path).exists()]
    for link in links:
        path, _, anchor = link.partition("#")
        target = document.parent / path if path else document
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    assert not broken


def pages_in(nav: list[Any]) -> Iterator[str]:
    """The pages of a navigation, and of its sections."""
    for entry in nav:
        if isinstance(entry, str):
            yield entry
        else:
            for section in entry.values():
                yield from pages_in(section)


def test_the_site_lists_every_page() -> None:
    nav = re.split(r"^(?=\S)", (ROOT / "mkdocs.yml").read_text("utf-8"), flags=re.MULTILINE)
    (listed,) = [yaml.safe_load(part)["nav"] for part in nav if part.startswith("nav:")]
    assert sorted(pages_in(listed)) == sorted(path.name for path in ROOT.glob("docs/*.md"))


def test_every_result_is_linked_from_the_table_of_results() -> None:
    table = (ROOT / "docs/performance.md").read_text("utf-8")
    missing = [path.name for path in ROOT.glob("docs/results/*.md") if f"(results/{path.name})" not in table]
    assert not missing
