"""A counterpart's own tests run in a process of their own: its modules have plain names, and its messages those of ours."""

collect_ignore = ["generation_b", "imc_console", "nanomodem"]
