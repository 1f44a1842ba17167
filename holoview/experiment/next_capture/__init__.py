"""The next capture is the one that tells most about the cause in a second on the bench.

closed_loop      takes captures until the cause is certain, or a budget is spent; planners
hypotheses       what may be the cause: fits, evidence, probabilities
capture_choice   captures that could be taken; the proposal of most information per second, its pattern improved by
                 gradient, and the reason
"""
