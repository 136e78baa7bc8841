"""`apf batch`: the command, the takes it is given, and what a worker does with one."""
