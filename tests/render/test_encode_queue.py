"""Which image is encoded next."""

from __future__ import annotations

from tigas_render.encode_queue import EncodeQueue


def queue(encoders: int, *images: str) -> EncodeQueue[str]:
    made: EncodeQueue[str] = EncodeQueue(encoders)
    for image in images:
        made.put(image[0], image)
    made.close()
    return made


def test_images_are_encoded_in_their_order() -> None:
    images = queue(3, "a1", "b1", "a2")
    assert [images.take() for _ in range(3)] == [("a", "a1"), ("b", "b1"), ("a", "a2")]
    assert images.take() is None


def test_one_encoder_is_left_for_others() -> None:
    images = queue(2, "a1", "a2", "b1")
    assert [images.take(), images.take()] == [("a", "a1"), ("b", "b1")]
    images.done("a")
    assert images.take() == ("a", "a2")


def test_a_single_encoder_is_everybodys() -> None:
    images = queue(1, "a1", "a2")
    assert images.take() == ("a", "a1")
    images.done("a")
    assert images.take() == ("a", "a2")
