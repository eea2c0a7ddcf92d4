"""When a normal is in doubt: one rule, in the numbers that all who apply it share.

A vector is a sum of products, whose rounding errors are at most `NOISE` times the sum of their
sizes, plus `TINY` for what underflow takes; it is lost where its largest component is no larger.
Of two vectors whose largest components have relative errors e and f, the unit vectors have errors
of at most sqrt(3) < `UNIT` times as much: they might be dependent where no component of their cross
product exceeds UNIT (e + f). `reference.unit_normals` is the rule. Kernels that take their cross
product from vectors of largest component 1, at most sqrt(3) long, ask for a length above
SCALED (e + f), SCALED = UNIT sqrt(3) sqrt(3): what fails is left to the reference, whose word is
the last.
"""

NOISE = 16 * 2.0**-52  # relative, of sums of products of rounded numbers
TINY = 2.0**-1000
UNIT, SCALED = 2, 6
