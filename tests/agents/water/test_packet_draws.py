"""Random numbers in the water: keyed, uniform or normal as stated, and independent of all but its key."""

from statistics import correlation, fmean, pstdev

from agents.water.packet_draws import fates


def test_they_are_distributed_as_stated() -> None:
    drawn = [fates(1, sender, 37 * n, 0, b"sound") for sender in range(1, 11) for n in range(1000)]
    first, second, normal = (list(it) for it in zip(*drawn, strict=True))
    for uniform in (first, second):
        # The standard deviation of 10 000 draws' mean is 0.0029, of a tenth's share 0.003: four times that.
        assert abs(fmean(uniform) - 0.5) < 0.012
        assert all(
            abs(sum(n / 10 <= it < (n + 1) / 10 for it in uniform) / 1e4 - 0.1) < 0.012 for n in range(10)
        )
    assert abs(fmean(normal)) < 0.04 and abs(pstdev(normal) - 1) < 0.03
    assert abs(sum(abs(it) < 1 for it in normal) / 1e4 - 0.6827) < 0.019
    for one, other in ((first, second), (first, normal), (second, normal)):
        assert abs(correlation(one, other)) < 0.04


def test_every_part_of_the_key_counts() -> None:
    keys = [(1, 2, 3, 4, b"sound"), (2, 2, 3, 4, b"sound"), (1, 3, 3, 4, b"sound"), (1, 2, 4, 4, b"sound")]
    keys += [(1, 2, 3, 5, b"sound"), (1, 2, 3, 4, b"wifi"), (1, 4, 3, 2, b"sound")]
    assert len({fates(*key) for key in keys}) == len(keys)
    assert fates(*keys[0]) == fates(*keys[0])
