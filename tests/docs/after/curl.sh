# What the dots of docs/curl.md stood for.
jq -e '
  .simulated and .job.state == "converged" and (.job.report |
    (.delta_v_mm - .delta_v_target_mm | fabs) < 0.05 and
    .e_mm > .e_tolerance.low_mm and .e_mm < .e_tolerance.high_mm and
    (.spacing_px - .spacing_target_px | fabs) < 0.05 and .spacing_sigma_px < 0.05) and
  (.operator_steps | length) == 4 and all(.operator_steps[]; .confirmed_at)
' export.json >/dev/null || { echo "the report is not that of an aligned camera"; jq .job.report export.json; exit 1; }
grep -q SIMULATED report.html
grep -qi 'iteration\|stage' export.csv
[[ $(head -c 2 frame.jpg | od -An -tx1 | tr -d ' ') == ffd8 ]] || { echo "frame.jpg is no JPEG"; exit 1; }
