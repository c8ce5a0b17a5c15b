"""Unusual request targets: methods, paths, queries and header fields."""

from __future__ import annotations

from collections.abc import Sequence

from hypothesis import strategies as st

METHODS = (
    "GET",
    "HEAD",
    "POST",
    "PUT",
    "DELETE",
    "OPTIONS",
    "PATCH",
    "TRACE",
    "CONNECT",
    "PROPFIND",
    "",
    "get",
    "x" * 300,
)
NAMES = (
    *("..", ".", "", "%2e%2e", "%2f", "..%2f..%2fetc%2fpasswd"),
    *("%00", "a%00b", "%0d%0a", "%ff", "%ed%a0%80", "%", "%zz"),
    *("-1", "0", "1", "99999999999999999999", "1e3", "٣", "²"),
    *("x" * 255, "x" * 5000, "a b", "a+b", "=cmd|x", "<script>"),
    *("\\", "C:", "CON", "~", "*", "?", "#", ";", "//", "http://elsewhere/", "{id}", "\x7f", "é", "\u202e"),
)  # fmt: skip
QUERIES = (
    "",
    "?",
    "?scan=1",
    "?scan=%ff",
    "?name=../../x.csv",
    "?name=%00",
    "?name=" + "n" * 5000,
    "?a&b=&=c&a=1",
    "?%ff=%ff",
    "?#",
)
HEADERS = (
    *(b"[", b"[::1", b"[::1]:x", b"a:b:c", b"", b":", b"@", b"a@b"),
    *(b"/", b"//", b"\xff", b"localhost:99999", b"localhost:-1"),
    *(b"evil.example", b"127.0.0.1:8080", b"[::1]:8080", b"x" * 3000, b"null", b"http://[", b"http://localhost:8080"),
    *(b'"><script>', b"a b", b"%00", b"-1", b"1e9", b"gzip, br", b"bytes=0-", b"bytes=9-1,-", b"bytes=a"),
)  # fmt: skip
FIELDS = (
    *(b"host", b"origin", b"referer", b"cookie", b"content-type", b"accept-encoding", b"range", b"if-range"),
    *(b"if-none-match", b"if-modified-since", b"forwarded", b"x-forwarded-host", b"access-control-request-method"),
    *(b"access-control-request-headers", b"authorization", b"expect"),
)  # fmt: skip


def paths(routes: Sequence[str]) -> st.SearchStrategy[str]:
    """Paths near an application's routes, with `{}` for a name."""
    names = st.sampled_from(NAMES)
    filled = st.builds(lambda route, *parts: route.format(*parts), st.sampled_from(list(routes)), *[names] * 3)
    return st.builds(
        lambda path, more, query: path + more + query,
        filled,
        st.just("") | names.map(lambda name: f"/{name}"),
        st.sampled_from(QUERIES),
    )


def headers(host: bytes, *known: tuple[bytes, bytes]) -> st.SearchStrategy[list[tuple[bytes, bytes]]]:
    """Fields of a request, some of them twice or absurd."""
    odd = st.tuples(st.sampled_from(FIELDS), st.sampled_from(HEADERS))
    usual = [(b"host", host), *known]
    return st.builds(
        lambda odd, replace: odd + [field for field in usual if not replace or field[0] not in dict(odd)],
        st.lists(odd, max_size=3),
        st.booleans(),
    )
