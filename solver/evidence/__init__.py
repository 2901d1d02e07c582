"""Evidence about a fit: causes, scatter, mistakes, resampling; each module gives data, no verdicts."""
