"""For every test: a slow machine, or one that does other things too, is no reason to fail; nor is a suite under nohup."""

import signal

from hypothesis import HealthCheck, settings

settings.register_profile("any_machine", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("any_machine")

# A shell's background job ignores SIGINT, and one under nohup SIGHUP: what is ignored is handed on to every child.
for number, usual in ((signal.SIGINT, signal.default_int_handler), (signal.SIGHUP, signal.SIG_DFL)):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, usual)
