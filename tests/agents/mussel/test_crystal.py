from agents.mussel.crystal import drift_of


def test_crystals_differ_and_stay_within_the_bound() -> None:
    drifts = [drift_of(7, agent_id, 50_000) for agent_id in range(1, 1001)]
    assert max(map(abs, drifts)) <= 50_000 and len(set(drifts)) > 950
    # Uniform: the mean's standard deviation is 50 000 / sqrt(3) / sqrt(1000) = 913.
    assert abs(sum(drifts) / 1000) < 4 * 913
    assert [drift_of(7, agent_id, 0) for agent_id in (1, 2)] == [0, 0]
    assert drift_of(8, 1, 50_000) != drift_of(7, 1, 50_000)
