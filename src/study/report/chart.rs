//! A chart as SVG.

use plotters::prelude::*;

use crate::study::Chart;

/// Size of a chart, CSS px.
const SIZE: (u32, u32) = (760, 420);
/// Colours that are told apart by the colour-blind too (Okabe and Ito), for one curve after the other.
const COLOURS: [RGBColor; 7] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 158, 115),
    RGBColor(204, 121, 167),
    RGBColor(86, 180, 233),
    RGBColor(230, 159, 0),
    RGBColor(90, 90, 90),
];
/// Share of its extent by which an axis goes beyond the points.
const MARGIN: f64 = 0.04;

/// Draws a chart, or says why it cannot be drawn.
pub(super) fn svg(chart: &Chart) -> Result<String, String> {
    let range = |axis: usize| -> Result<std::ops::Range<f64>, String> {
        let values = || chart.curves.iter().flat_map(|curve| &curve.points).map(|point| point[axis]);
        let finite = || values().filter(|value| value.is_finite());
        let (least, greatest) = (finite().fold(f64::INFINITY, f64::min), finite().fold(f64::NEG_INFINITY, f64::max));
        if least > greatest {
            return Err("nothing to draw".to_owned());
        }
        let margin = ((greatest - least) * MARGIN).max(1e-9 + 1e-6 * greatest.abs());
        Ok(least - margin..greatest + margin)
    };
    let (x, y) = (range(0)?, range(1)?);
    let mut text = String::new();
    draw(&mut text, chart, x, y).map_err(|error| format!("the chart could not be drawn: {error}"))?;
    Ok(text)
}

fn draw(
    text: &mut String,
    chart: &Chart,
    x: std::ops::Range<f64>,
    y: std::ops::Range<f64>,
) -> Result<(), Box<dyn std::error::Error>> {
    let area = SVGBackend::with_string(text, SIZE).into_drawing_area();
    let mut context = ChartBuilder::on(&area)
        .margin(10)
        .x_label_area_size(46)
        .y_label_area_size(66)
        .build_cartesian_2d(x, y)
        .map_err(|error| error.to_string())?;
    context
        .configure_mesh()
        .x_desc(&chart.x)
        .y_desc(&chart.y)
        .light_line_style(WHITE)
        .bold_line_style(RGBColor(225, 225, 225))
        .label_style(("sans-serif", 13))
        .axis_desc_style(("sans-serif", 14))
        .draw()
        .map_err(|error| error.to_string())?;
    for (curve, colour) in chart.curves.iter().zip(COLOURS.iter().cycle()) {
        let points = curve.points.iter().filter(|point| point.iter().all(|value| value.is_finite()));
        let points = points.map(|&[x, y]| (x, y));
        if curve.marks {
            context
                .draw_series(points.map(|point| Circle::new(point, 4, colour.filled())))
                .map_err(|error| error.to_string())?
                .label(&curve.name)
                .legend(move |(x, y)| Circle::new((x + 10, y), 4, colour.filled()));
        } else {
            context
                .draw_series(LineSeries::new(points, colour.stroke_width(2)))
                .map_err(|error| error.to_string())?
                .label(&curve.name)
                .legend(move |(x, y)| PathElement::new(vec![(x, y), (x + 20, y)], colour.stroke_width(2)));
        }
    }
    context
        .configure_series_labels()
        .background_style(WHITE.mix(0.85))
        .border_style(RGBColor(200, 200, 200))
        .label_font(("sans-serif", 13))
        .draw()
        .map_err(|error| error.to_string())?;
    area.present().map_err(|error| error.to_string())?;
    drop(context);
    drop(area);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::study::Curve;

    #[test]
    fn a_chart_has_its_axes_and_curves() {
        let chart = Chart {
            name: "n".to_owned(),
            title: "t".to_owned(),
            x: "distance, mm".to_owned(),
            y: "δ & more, px".to_owned(),
            curves: vec![
                Curve::line("theory", vec![[1.0, 2.0], [2.0, f64::NAN], [3.0, 1.0]]),
                Curve::marks("measured", vec![[2.0, 1.5]]),
            ],
        };
        let drawn = svg(&chart).unwrap();
        for text in ["<svg", "distance, mm", "δ &amp; more, px", "theory", "measured", "<circle", "<polyline"] {
            assert!(drawn.contains(text), "{text}");
        }
        assert!(!drawn.contains("NaN"), "{drawn}");
        assert!(svg(&Chart { curves: Vec::new(), ..chart }).is_err());
    }
}
