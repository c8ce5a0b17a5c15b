"""Who may change something: pages that are named, and whoever else a service lets."""

from __future__ import annotations

import pytest

from tigas_common.origins import ForeignOrigin, OriginPolicy

PAGE = "https://page.example"
STRICT = OriginPolicy((PAGE,))
LENIENT = OriginPolicy((PAGE,), own_host=True, programs=True)


def allows(policy: OriginPolicy, origin: str | None, host: str = "127.0.0.1:8091") -> bool:
    try:
        policy.check(origin, host)
    except ForeignOrigin:
        return False
    return True


@pytest.mark.parametrize(
    ("origin", "strict", "lenient"),
    [
        (PAGE, True, True),
        (None, False, True),
        ("http://127.0.0.1:8080", False, True),
        ("http://localhost:8080", False, True),
        ("https://evil.example", False, False),
        ("http://127.0.0.1.evil.example", False, False),
        (f"{PAGE}.evil.example", False, False),
        ("null", False, False),
        ("http://[", False, False),
        ("", False, False),
    ],
)
def test_named_pages_and_those_that_the_policy_lets_may_change_something(
    origin: str | None, strict: bool, lenient: bool
) -> None:
    assert (allows(STRICT, origin), allows(LENIENT, origin)) == (strict, lenient)


@pytest.mark.parametrize(
    ("host", "allowed"),
    [
        ("labhost", True),
        ("lab.local", True),
        ("lab.internal", True),
        ("10.1.2.3", True),
        ("[2001:db8::1]", True),
        ("evil.example", False),
    ],
)
def test_a_host_that_anybody_may_name_is_not_our_own(host: str, allowed: bool) -> None:
    assert allows(LENIENT, f"http://{host}:8080", f"{host}:8091") is allowed
    assert not allows(LENIENT, f"http://{host}:8080", "127.0.0.1:8091")


def test_a_refusal_names_the_origin_but_not_all_of_it() -> None:
    with pytest.raises(ForeignOrigin, match=r"not https://evil\.example"):
        STRICT.check("https://evil.example", "127.0.0.1")
    with pytest.raises(ForeignOrigin) as refused:
        STRICT.check("x" * 10_000, "127.0.0.1")
    assert len(refused.value.detail) < 200
