"""Which gains: rho, time constants and coordinators of a wired network."""
