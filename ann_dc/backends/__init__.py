"""How a network runs: in continuous time (`ode`), in discrete time (`recurrent`)."""
