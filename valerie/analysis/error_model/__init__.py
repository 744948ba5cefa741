"""Models of the probability of a miss and quantiles of pACC for a planner's simulation."""
