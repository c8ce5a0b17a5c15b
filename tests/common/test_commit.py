"""The code's commit, from the image or the working tree."""

from __future__ import annotations

import re

import pytest

from tigas_common.commit import VARIABLE, this_commit


def test_the_working_tree_tells(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    told = this_commit()
    assert told is None or re.fullmatch(r"[0-9a-f]{12}(-dirty)?", told)
    monkeypatch.setenv("PATH", "")
    assert this_commit() is None, "without git nobody knows"


def test_an_image_says_it_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, "abc")
    assert this_commit() == "abc"
    monkeypatch.setenv(VARIABLE, "")  # built without it
    monkeypatch.setenv("PATH", "")
    assert this_commit() is None
