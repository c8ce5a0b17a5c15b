"""Edits of bytes that anybody may have damaged: cut, flipped, repeated, spliced."""

from __future__ import annotations

from collections.abc import Sequence

from hypothesis import strategies as st

MOST_EDITS = 4


@st.composite
def edited(draw: st.DrawFn, contents: st.SearchStrategy[bytes], pieces: Sequence[bytes] = ()) -> bytes:
    """Contents after a few edits; `pieces` are meaningful bytes of the format, inserted at wrong places."""
    content = draw(contents)
    inserted = st.binary(max_size=8)
    if pieces:
        inserted = st.sampled_from(pieces) | inserted
    for _ in range(draw(st.integers(0, MOST_EDITS))):
        begin = draw(st.integers(0, len(content)))
        end = min(len(content), begin + draw(st.sampled_from((0, 0, 1, 1, 2, 4, 8, 64, len(content)))))
        middle = content[begin:end]
        match draw(st.sampled_from(("replace", "replace", "repeat", "cut", "reverse"))):
            case "replace":
                middle = draw(inserted)
            case "repeat":
                middle *= draw(st.sampled_from((2, 3, 50)))
            case "cut":
                end = len(content)
                middle = b""
            case "reverse":
                middle = middle[::-1]
        content = content[:begin] + middle + content[end:]
    return content


@st.composite
def chunked(draw: st.DrawFn, content: bytes, most: int = 12) -> list[bytes]:
    """The same bytes in pieces, some of them empty."""
    cuts = sorted(draw(st.lists(st.integers(0, len(content)), max_size=most)))
    return [content[begin:end] for begin, end in zip([0, *cuts], [*cuts, len(content)], strict=True)]
