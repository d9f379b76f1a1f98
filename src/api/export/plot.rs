//! Plots as inline SVG: values by iteration or by position with their uncertainties, and a map over the field.

use std::fmt::Write as _;

use crate::text::escape;

const WIDTH: f64 = 720.0;
const HEIGHT: f64 = 240.0;
const LEFT: f64 = 70.0;
const RIGHT: f64 = 12.0;
const TOP: f64 = 12.0;
const BOTTOM: f64 = 34.0;

/// A value at an iteration or a position.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Point {
    /// Number of the iteration, or the position.
    pub(super) at: f64,
    /// The value.
    pub(super) value: f64,
    /// Half the length of its bar.
    pub(super) bar: Option<f64>,
}

/// Values of one kind.
pub(super) struct Series<'a> {
    /// What they are.
    pub(super) name: &'a str,
    /// Class in the style sheet, which has its colour.
    pub(super) class: &'a str,
    /// In order.
    pub(super) points: Vec<Point>,
    /// Whether every value is marked.
    pub(super) marked: bool,
}

struct Axis {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
}

impl Axis {
    fn at(&self, value: f64) -> f64 {
        self.from + (value - self.low) / (self.high - self.low) * (self.to - self.from)
    }
}

/// Values with about so many steps between, or fewer, at round numbers.
fn ticks(low: f64, high: f64, about: f64) -> (Vec<f64>, usize) {
    let rough = (high - low) / about;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|n| n * power).find(|step| 1.1 * *step >= rough).unwrap_or(rough);
    let digits = (-step.log10().floor()).max(0.0) as usize;
    let first = (low / step).ceil() as i64;
    let last = (high / step).floor() as i64;
    ((first..=last).map(|n| n as f64 * step).collect(), digits)
}

/// Values by iteration; `None` where there are none to draw.
pub(super) fn by_iteration(title: &str, unit: &str, series: &[Series<'_>]) -> Option<String> {
    let marks = |low: f64, high: f64| {
        let (first, last) = (low.ceil() as u32, high.floor() as u32);
        let every = (last - first) / 20 + 1;
        ((first..=last).step_by(every as usize).map(f64::from).collect(), 0)
    };
    drawn(title, ("", unit), series, 0.5, marks)
}

/// Values by position, which `place` says; `None` where there are none to draw.
pub(super) fn by_position(title: &str, place: &str, unit: &str, series: &[Series<'_>]) -> Option<String> {
    let reach = series.iter().flat_map(|series| &series.points).map(|point| point.at);
    let (low, high) = reach.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), at| (low.min(at), high.max(at)));
    drawn(title, (place, unit), series, ((high - low) * 0.04).max(1e-6), |low, high| ticks(low, high, 8.0))
}

fn drawn(
    title: &str,
    (place, unit): (&str, &str),
    series: &[Series<'_>],
    beside: f64,
    marks_of: impl Fn(f64, f64) -> (Vec<f64>, usize),
) -> Option<String> {
    let finite = |point: &&Point| point.value.is_finite();
    let points: Vec<&Point> = series.iter().flat_map(|series| series.points.iter()).filter(finite).collect();
    if points.is_empty() {
        return None;
    }
    let places = || points.iter().map(|p| p.at);
    let (first, last) = (places().fold(f64::INFINITY, f64::min), places().fold(f64::NEG_INFINITY, f64::max));
    let reach = |point: &Point| point.bar.filter(|bar| bar.is_finite()).unwrap_or(0.0);
    let low = points.iter().map(|p| p.value - reach(p)).fold(f64::INFINITY, f64::min);
    let high = points.iter().map(|p| p.value + reach(p)).fold(f64::NEG_INFINITY, f64::max);
    let margin = ((high - low) * 0.06).max(high.abs().max(low.abs()) * 1e-4).max(1e-6);
    let x = Axis { low: first - beside, high: last + beside, from: LEFT, to: WIDTH - RIGHT };
    let y = Axis { low: low - margin, high: high + margin, from: HEIGHT - BOTTOM, to: TOP };
    let mut svg = format!(
        "<svg class=\"plot\" viewBox=\"0 0 {WIDTH} {HEIGHT}\" role=\"img\" aria-label=\"{}\">\n",
        escape(title)
    );
    let (marks, digits) = ticks(y.low, y.high, 5.0);
    for mark in marks {
        let at = y.at(mark);
        let _ = writeln!(
            svg,
            "<line class=\"grid\" x1=\"{LEFT}\" x2=\"{}\" y1=\"{at:.1}\" y2=\"{at:.1}\"/><text class=\"y\" x=\"{}\" y=\"{:.1}\">{mark:.digits$}</text>",
            WIDTH - RIGHT,
            LEFT - 6.0,
            at + 4.0
        );
    }
    let (marks, digits) = marks_of(x.low, x.high);
    for mark in marks {
        let at = x.at(mark);
        let _ =
            writeln!(svg, "<text class=\"x\" x=\"{at:.1}\" y=\"{:.1}\">{mark:.digits$}</text>", HEIGHT - BOTTOM + 16.0);
    }
    if !place.is_empty() {
        let _ =
            writeln!(svg, "<text class=\"y\" x=\"{}\" y=\"{}\">{}</text>", WIDTH - RIGHT, HEIGHT - 3.0, escape(place));
    }
    for (index, series) in series.iter().enumerate() {
        draw(&mut svg, series, &x, &y);
        let at = LEFT + 8.0 + 170.0 * index as f64;
        let _ = writeln!(
            svg,
            "<g class=\"{0}\"><line class=\"line\" x1=\"{at}\" x2=\"{1}\" y1=\"{2}\" y2=\"{2}\"/><text class=\"key\" x=\"{3}\" y=\"{4}\">{5}</text></g>",
            series.class,
            at + 18.0,
            HEIGHT - 7.0,
            at + 24.0,
            HEIGHT - 3.0,
            escape(series.name)
        );
    }
    let _ = writeln!(
        svg,
        "<text class=\"unit\" transform=\"translate(14 {}) rotate(-90)\">{}</text>\n</svg>",
        (HEIGHT - BOTTOM + TOP) / 2.0,
        escape(unit)
    );
    Some(svg)
}

fn draw(svg: &mut String, series: &Series<'_>, x: &Axis, y: &Axis) {
    let _ = write!(svg, "<g class=\"{}\">", series.class);
    let mut path = String::new();
    for point in series.points.iter().filter(|point| point.value.is_finite()) {
        let (px, py) = (x.at(point.at), y.at(point.value));
        let _ = write!(path, "{}{px:.1} {py:.1} ", if path.is_empty() { "M" } else { "L" });
        if let Some(bar) = point.bar.filter(|bar| bar.is_finite()) {
            let (from, to) = (y.at(point.value - bar), y.at(point.value + bar));
            let _ = write!(
                svg,
                "<path class=\"bar\" d=\"M{px:.1} {from:.1}V{to:.1}M{0:.1} {from:.1}h6M{0:.1} {to:.1}h6\"/>",
                px - 3.0
            );
        }
        if series.marked {
            let _ = write!(svg, "<circle cx=\"{px:.1}\" cy=\"{py:.1}\" r=\"3\"/>");
        }
    }
    let _ = writeln!(svg, "<path class=\"line\" d=\"{}\"/></g>", path.trim_end());
}

/// Regions of the map along the longer side.
const REGIONS: usize = 12;

/// A map over the field: `value` at places whose x runs from -1 to 1 over the frame's width, y over its height in the
/// same measure. Red is positive, blue negative, white nothing.
pub(super) fn field_map(title: &str, unit: &str, height_by_width: f64, value: impl Fn(f64, f64) -> f64) -> String {
    let columns = REGIONS;
    let rows = ((REGIONS as f64 * height_by_width).round() as usize).clamp(1, 4 * REGIONS);
    let place = |index: usize, count: usize, half: f64| ((index as f64 + 0.5) / count as f64 * 2.0 - 1.0) * half;
    let values: Vec<f64> = (0..rows * columns)
        .map(|n| value(place(n % columns, columns, 1.0), place(n / columns, rows, height_by_width)))
        .collect();
    let largest = values.iter().fold(0.0f64, |largest, value| largest.max(value.abs())).max(1e-9);
    let side = 30.0;
    let (width, height) = (columns as f64 * side, rows as f64 * side);
    let mut svg = format!(
        "<svg class=\"map\" viewBox=\"0 0 {} {}\" role=\"img\" aria-label=\"{}\">\n",
        width + 130.0,
        height.max(150.0) + 2.0,
        escape(title)
    );
    for (n, value) in values.iter().enumerate() {
        let (x, y) = ((n % columns) as f64 * side, (n / columns) as f64 * side);
        let _ = writeln!(
            svg,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{side}\" height=\"{side}\" fill=\"{}\"><title>{value:+.4} {}</title></rect>",
            colour(value / largest),
            escape(unit)
        );
    }
    for n in 0..=10 {
        let share = 1.0 - f64::from(n) / 5.0;
        let y = f64::from(n) * 13.0;
        let _ = writeln!(
            svg,
            "<rect x=\"{}\" y=\"{y}\" width=\"16\" height=\"13\" fill=\"{}\"/>",
            width + 16.0,
            colour(share)
        );
        if n % 5 == 0 {
            let _ = writeln!(
                svg,
                "<text class=\"key\" x=\"{}\" y=\"{}\">{:+.4} {}</text>",
                width + 38.0,
                y + 11.0,
                share * largest,
                escape(unit)
            );
        }
    }
    svg.push_str("</svg>");
    svg
}

/// White at 0, red at 1, blue at -1.
fn colour(share: f64) -> String {
    let share = if share.is_finite() { share.clamp(-1.0, 1.0) } else { 0.0 };
    let towards = |end: f64| (255.0 + (end - 255.0) * share.abs()).round() as u8;
    let [r, g, b] = if share >= 0.0 { [178.0, 24.0, 43.0] } else { [33.0, 102.0, 172.0] }.map(towards);
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(number: u32, value: f64) -> Point {
        Point { at: f64::from(number), value, bar: Some(0.1) }
    }

    #[test]
    fn ticks_stand_at_round_numbers() {
        let (marks, digits) = ticks(19.62, 20.13, 5.0);
        assert_eq!(digits, 1);
        assert!(marks.iter().zip([19.7, 19.8, 19.9, 20.0, 20.1]).all(|(a, b)| (a - b).abs() < 1e-9), "{marks:?}");
        assert_eq!(ticks(0.0, 30.0, 5.0), (vec![0.0, 10.0, 20.0, 30.0], 0));
    }

    #[test]
    fn a_plot_has_a_mark_and_a_bar_for_every_value_and_none_for_what_is_none() {
        let points = vec![point(1, 20.0), point(2, f64::NAN), Point { bar: Some(f64::INFINITY), ..point(3, 19.0) }];
        let series = [Series { name: "a <b>", class: "measured", points, marked: true }];
        let svg = by_iteration("t", "px", &series).unwrap();
        assert_eq!(svg.matches("<circle").count(), 2);
        assert_eq!(svg.matches("class=\"bar\"").count(), 1);
        assert!(svg.contains("a &lt;b&gt;") && !svg.contains("NaN") && !svg.contains("inf"), "{svg}");
        assert!(by_iteration("t", "px", &[]).is_none());
    }

    #[test]
    fn positions_have_round_marks_and_are_where_they_are() {
        let points = [1.96, 2.1, 2.44].map(|at| Point { at, value: 10.0 * at, bar: None }).to_vec();
        let series = [Series { name: "a", class: "measured", points, marked: true }];
        let svg = by_position("t", "position, mm", "px", &series).unwrap();
        assert!(svg.contains(">2.0<") && svg.contains(">2.4<") && svg.contains("position, mm"), "{svg}");
        let xs: Vec<f64> =
            svg.split("cx=\"").skip(1).map(|rest| rest.split('"').next().unwrap().parse().unwrap()).collect();
        assert!(((xs[1] - xs[0]) / (xs[2] - xs[0]) - 0.14 / 0.48).abs() < 0.01, "{xs:?}");
        assert!(by_position("t", "", "px", &[]).is_none());
    }

    #[test]
    fn one_single_value_is_drawn_too() {
        let series =
            [Series { name: "a", class: "measured", points: vec![Point { bar: None, ..point(1, 0.0) }], marked: true }];
        let svg = by_iteration("t", "px", &series).unwrap();
        assert!(svg.contains("<circle") && !svg.contains("NaN"), "{svg}");
    }

    #[test]
    fn a_map_is_white_where_nothing_is_wrong_and_has_both_signs() {
        let svg = field_map("t", "px", 0.5, |x, _| x);
        assert_eq!(svg.matches("<title>").count(), 12 * 6);
        assert!(svg.contains("#b2182b") && svg.contains("#2166ac"));
        assert_eq!(colour(0.0), "#ffffff");
    }
}
