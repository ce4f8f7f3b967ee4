"""How a network runs: in continuous time (`ode`)."""
