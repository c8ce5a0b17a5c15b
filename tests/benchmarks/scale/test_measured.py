"""The figures that plans rest on."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.scale.measured import FIGURES, Measured

DOCS = Path(__file__).parents[3] / "docs"


@pytest.mark.parametrize("figure", FIGURES, ids=lambda figure: figure.what)
def test_a_figure_is_in_the_document_that_it_is_from(figure: Measured) -> None:
    text = (DOCS / figure.document).read_text()
    assert figure.printed in text
    assert figure.commit in text
