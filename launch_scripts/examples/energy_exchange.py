# The paper's energy exchange (Fig. 7) as a script: wait for four, collect, charge, bring back.
# scenario: ../scenarios/pool-12.yaml
while True:
    api.wait_until(lambda: len(api.pool()) >= 4, timeout=3600)
    for agent, dock in api.plan_collection().steps:
        if not api.collect(agent, dock):
            print(f"aMussel {agent} was not collected: {api.failure}")
    docked = [agent for agent in api.docks().values() if agent is not None]
    print(f"charging {docked} after {api.cost():.1f} m")
    api.wait_until(lambda: all(api.is_full(agent) for agent in docked), timeout=3600)
    for agent, _ in api.plan_redeployment().steps:
        api.deploy(agent)
