# A behaviour: fetches the first aMussel that falls below the threshold, charges it to 90 % and brings it home; serves two.
# scenario: ../scenarios/pool-12.yaml
from apad_bridge.scripting.api import Behaviour


class FirstInNeed(Behaviour):
    def __init__(self, how_many):
        self.how_many = how_many
        self.queue = []

    def event(self, api, event):
        if event.kind == "low" and event.agent not in self.queue:
            self.queue.append(event.agent)

    def tick(self, api):
        if self.queue and self.serve(api, self.queue.pop(0)):
            self.how_many -= 1
        return self.how_many == 0

    def serve(self, api, agent):
        print(f"aMussel {agent} is at {api.battery(agent):.0%}")
        if not api.collect(agent, api.free_docks()[0]):
            print(f"not collected: {api.failure}")
            return False
        api.wait_until(lambda: api.battery(agent) >= 0.9, timeout=1200)
        return api.deploy(agent)


if not api.run(FirstInNeed(2), timeout=2000):
    print("nobody else was in need")
