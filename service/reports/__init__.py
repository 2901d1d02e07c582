"""Reports that people sign: one document a run or another job, as PDF and as HTML."""
