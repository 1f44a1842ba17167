"""Settings of the forward selection of causes, and of their ranking on held-out captures."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class RankingConfig:
    """Order of candidates on held-out captures."""

    near_chi2: float = 1.3
    """[χ²/n] Below it the weights of the noise order candidates, above it tolerant weights; a single cause that
    reaches it is ranked at once. Evidence: weights from a wrong model favour similar errors; the value: none
    recorded."""

    tie_excess_share: float = 0.02
    """[1] Candidates within this share of the best excess tie, apart from the next two. Evidence: the search
    study."""

    tie_excess: float = 0.02
    """[χ²/n] … and within this χ²/n. Evidence: the search study."""

    tie_near_share: float = 0.1
    """[1] … which counts at most as this share of the excess, so that near the floor small differences decide.
    Evidence: none recorded."""


@dataclass(frozen=True)
class SelectionConfig:
    """Which candidates are pursued, and when the selection ends."""

    short_list: int = 3
    """[fits] The best of a screening are refined. Evidence: the search study."""

    close_fits: int = 2
    """[fits] Refined beyond these where they are close. Evidence: the search study."""

    close_cost: float = 1.3
    """[1] Close: less than so many times the best cost. Evidence: the search study."""

    as_good_cost: float = 1.05
    """[1] Of one batch, fits below so many times the best cost are refined at once. Evidence: none recorded."""

    bases: int = 3
    """[candidates] Single causes on which a second one is tried; of larger sets, the best alone. One more is what the
    best pair adds to one of them. Evidence: the search study."""

    joint_fits: int = 3
    """[fits] Joint fits of a base and one more cause after each stage of a screening. Evidence: none recorded."""

    refined_joint_fits: int = 2
    """[fits] The best of these are refined. Evidence: none recorded."""

    max_causes: int = 3
    """[causes] At most so many are named. Evidence: the search study named pairs only; more: none recorded."""

    floor_chi2: float = 1.05
    """[χ²/n] Below it no further cause is searched. Evidence: the search study."""

    axis_candidates: int = 2
    """[candidates] Searched along their axes. Evidence: none recorded."""

    axis_rounds: int = 2
    """[1] Rounds of that. Evidence: none recorded."""

    axis_gain_share: float = 0.9
    """[1] … of which the second follows if the first left less than this share of the excess. Evidence: a round for two
    causes takes a tenth of a minute; the value: none recorded."""

    last_fits: int = 3
    """[candidates] Fitted to the end at most, where they are near the floor. Evidence: the cost; the best and two
    rivals."""

    near_error_share: float = 0.2
    """[1] A candidate is polished if its error is below this share of the nominal model's. Evidence: what stays far
    off lacks a cause, with which other values would be best; the value: none recorded."""

    near_error: float = 0.02
    """[error] … or below this error. Evidence: none recorded; paired with `FitConfig.tolerant_min_error`."""

    max_near_error: float = 0.1
    """[error] … which counts at most as this error. Evidence: of pairs with errors above 1, searches along the axes of
    the first cause, which left an error of 0.2, took a third of the time and gained nothing."""

    explains_nothing_share: float = 0.9
    """[1] Candidates that leave more than this share of the nominal excess aren't polished. Evidence: none
    recorded."""

    settled_excess: float = 0.1
    """[χ²/n] No further stage of the screening, and no further base, if the best excess is below this …
    Evidence: scans of ranges bring nothing so close; the value: none recorded."""

    settled_share: float = 0.05
    """[1] … and below this share of the nominal excess; a further cause that leaves less than this share of its base's
    excess ends a screening. Evidence: none recorded."""

    promising_share: float = 0.5
    """[1] A second cause is tried before ranges are scanned, if the best cause leaves less than this share of the
    nominal excess, on held-out or on smooth captures; for a further cause no ranges are scanned, if one leaves less
    than this share of the cost. Evidence: beside a cause that was found near the nominal bench, the other one is mostly
    near too; the scans take half of a minute; the value: none recorded. Smooth captures: beside light of the other
    polarisation, the true angle of a stage explained six tenths of them, and nothing of rough ones."""

    superfluous_cost: float = 2.0
    """[1] Without one of its causes, the best candidate is refined only if a fit to coarse captures costs less than so
    many times as much as with it. Evidence: derivation: fewer causes come first within a tenth of the excess."""

    joint_no_scan_chi2: float = 2.0
    """[χ²/n] A joint fit that reaches this on coarse captures ends the screening for a further cause. Evidence:
    none recorded; paired with `ScreeningConfig.no_scan_chi2`."""

    worthwhile_cost: float = 0.7
    """[1] A further cause that leaves less than this share of the base's excess is fitted jointly at once. Evidence:
    weak fringes beside a bandwidth left nothing of an excess of 0.23, and were passed over for twenty thousand fields
    while the share was one of the cost; the value: none recorded."""

    max_fine_excess_share: float = 0.9
    """[1] Fine parameters stay free if they leave less than this share of the excess. Evidence: none recorded."""

    max_further_excess_share: float = 0.8
    """[1] A further cause must leave less than this share of the excess. Evidence: none recorded."""

    reranked: int = 3
    """[candidates] Refined again once nuisances are known. Evidence: none recorded."""

    reranked_excess_factor: float = 4.0
    """[1] Of those whose excess is below so many times the best … Evidence: none recorded."""

    reranked_excess: float = 0.1
    """[χ²/n] … plus this. Evidence: none recorded."""
