"""How a network runs: in continuous time (`ode`), in discrete time (`recurrent`), as a circuit.

Every backend takes a `Network` and gives back the same `Run`: a trajectory over network time, and
in one sentence how it ended.
"""
