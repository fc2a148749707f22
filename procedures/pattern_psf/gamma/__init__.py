"""gamma, the amplification of noise: of a view of the chart, against s/t, and in words."""
