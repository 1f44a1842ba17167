"""Evidence for what holoview claims: figures of the paper made again, timings, cases with known answers.

study        the figures of the HoloChrome paper as jobs
benchmark    timings
conformance  cases of propagation with known answers, for any program
"""
