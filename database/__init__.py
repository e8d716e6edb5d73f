"""The ground floor: the data and its vocabulary, spoken by analysis, render and unitsel."""
