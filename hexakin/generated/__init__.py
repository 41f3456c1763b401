"""Generated kinematics of the shipped leg types, each named after the first robot that has it."""

MODULES = {
    "classical: p0 0 p1 0 | q0 0 p2 pi/2 | q1 0 p3 0 | q2 0 p4 0": ("hexakin.generated.athena", "hexakin.generated.athena_loops"),
    "modified at p0 p1 0: q0 p2 0 0 | q1 0 0 -pi/2 | q2 0 p3 0 | 0 0 p4 0": ("hexakin.generated.hwr", "hexakin.generated.hwr_loops"),
}
"""The modules of a leg type, numeric and loops, by its key."""
