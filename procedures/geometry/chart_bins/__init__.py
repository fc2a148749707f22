"""Where the cells of a chart are seen in a photograph, averaged over bins of the chart, with their covariance."""
