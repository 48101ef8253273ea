"""Engine x problem x quantity from results of several comparisons, engines of one scheme together."""
