from valerie.rendering.raster.gl.cache import LeastRecentlyUsed


class Held:
    def __init__(self) -> None:
        self.released = 0

    def release(self) -> None:
        self.released += 1


def test_an_entry_is_made_once() -> None:
    cache: LeastRecentlyUsed[Held] = LeastRecentlyUsed(2)
    assert cache.get("a", Held) is cache.get("a", Held)


def test_the_entry_used_longest_ago_is_released() -> None:
    cache: LeastRecentlyUsed[Held] = LeastRecentlyUsed(2)
    a, b = cache.get("a", Held), cache.get("b", Held)
    cache.get("a", Held)
    cache.get("c", Held)
    assert (a.released, b.released) == (0, 1)
    assert cache.get("a", Held) is a


def test_it_never_holds_more_than_its_capacity() -> None:
    cache: LeastRecentlyUsed[Held] = LeastRecentlyUsed(3)
    held = [cache.get(k, Held) for k in range(100)]
    assert len(cache) == 3
    assert sum(h.released for h in held) == 97


def test_clearing_releases_each_once() -> None:
    cache: LeastRecentlyUsed[Held] = LeastRecentlyUsed(3)
    held = [cache.get(k, Held) for k in range(3)]
    cache.clear()
    cache.clear()
    assert [h.released for h in held] == [1, 1, 1]
    assert len(cache) == 0
