"""Cases of propagation with known answers, for any program.

cases   answers from closed forms and float64 integrals, as files
score   the error of a result on such a case; also a program of its own
"""
