//! What Δv and e depend on: temperature and salinity of the water, the shell's parts, the curvature of the field that the
//! paraxial criterion does not see, and a shell that is not coaxial.

use std::sync::Arc;

use super::chapter::{Chapter, Chart, Curve, Finding, Table};
use super::{Desk, StudyError};
use crate::optics::{CameraDesign, water};
use crate::sim::renderer::{CameraTruth, Medium, Tracer};
use crate::sim::scene::Board;
use crate::sim::texture::TextureMap;

/// Wavelength at which water's index is taken, nm: the middle of what water lets through best.
const WAVELENGTH_NM: f64 = 550.0;

/// Makes the chapter.
pub(super) fn write(desk: &Desk<'_>) -> Result<Chapter, StudyError> {
    let config = desk.config;
    let design = config.design();
    let pixel = config.pixel_pitch().millimetres();
    let l_bound = config.assembly.l_bound_mm;
    let mut chapter = Chapter::default();
    parts(&mut chapter, &design, l_bound, pixel);
    waters(&mut chapter, &design, l_bound);
    desk.watch.done(1, 3);
    curvature(&mut chapter, &design, pixel)?;
    desk.watch.done(2, 3);
    decentre(&mut chapter, &design, l_bound, pixel);
    desk.watch.done(3, 3);
    Ok(chapter)
}

fn index(temperature: f64, salinity: f64) -> f64 {
    water::refractive_index(temperature, salinity, WAVELENGTH_NM).unwrap_or(f64::NAN)
}

/// How far the joint solution moves, and what a camera that is not adjusted again would show.
fn parts(chapter: &mut Chapter, design: &CameraDesign, l_bound: f64, pixel: f64) {
    type Change = (&'static str, f64, fn(&mut CameraDesign, f64));
    let changes: [Change; 8] = [
        ("temperature of the water, 10 °C more (from 20 °C, fresh)", 0.0, |design, _| {
            design.shell.n_water += index(30.0, 0.0) - index(20.0, 0.0);
        }),
        ("salinity, 35 ‰ more (from fresh, 20 °C)", 0.0, |design, _| {
            design.shell.n_water += index(20.0, 35.0) - index(20.0, 0.0);
        }),
        ("outer and inner radius, +1 mm both", 1.0, |design, by| {
            design.shell.outer_radius += by;
            design.shell.inner_radius += by;
        }),
        ("thickness, +0.1 mm (inner radius held)", 0.1, |design, by| design.shell.outer_radius += by),
        ("index of the shell, +0.005", 0.005, |design, by| design.shell.n_shell += by),
        ("object distance, +10 mm", 10.0, |design, by| design.object_distance += by),
        ("focal length of the main lens, +0.1 %", 1.001, |design, by| design.main_lens.focal_length *= by),
        ("distance of the board in the air design, +10 mm", 10.0, |design, by| design.air_distance += by),
    ];
    let joint = design.joint(l_bound);
    let mut table = Table::new(
        "sensitivity",
        "How the joint solution answers to what is not as designed",
        &["change", "Δv at the same e, µm", "e that meets Eq. 16 at the same Δv, mm", "spacing if nothing is done, px"],
    );
    let target = design.mla.target_spacing();
    for (name, by, apply) in changes {
        let mut changed = *design;
        apply(&mut changed, by);
        let equivalent = changed.shell.equivalent_distance(changed.object_distance, joint.e);
        // The MLA stays where it is; f and the air design's distance change what Δv is counted from.
        let kept = design.lens_to_mla(joint.delta_v);
        let a = changed.main_lens.image_distance(equivalent) - kept;
        let spacing = changed.mla.spacing(a);
        let image = changed.main_lens.image_distance(equivalent);
        let delta_v = image - (kept + design.mla.a());
        let needed = changed.main_lens.object_distance(kept + design.mla.a());
        let e = changed.shell.e_from_equivalent(needed, changed.object_distance) - joint.e;
        table.push([
            name.to_owned(),
            format!("{:+.1}", 1000.0 * delta_v),
            format!("{e:+.3}"),
            format!("{:+.4}", (spacing - target) / pixel),
        ]);
    }
    chapter.tables.push(table);
    chapter.text.push(
        "The paper names temperature and salt as hidden variables that may ask for optimising again, and the shell's radius \
         and index as parameters. The table says how much each moves the solution, and what happens to the spacing (in \
         image terms the blur) of a camera that is left as it is. The distance of the board in the air design moves \
         nothing that is in water: Δv is merely counted from another place."
            .to_owned(),
    );
}

/// Δv of the joint solution against temperature, for fresh and for sea water.
fn waters(chapter: &mut Chapter, design: &CameraDesign, l_bound: f64) {
    let curves: Vec<Curve> = [0.0, 10.0, 20.0, 35.0]
        .into_iter()
        .map(|salinity| {
            let points = (0..=30)
                .map(|t| {
                    let temperature = f64::from(t);
                    let mut changed = *design;
                    changed.shell.n_water = index(temperature, salinity);
                    [temperature, changed.joint(l_bound).delta_v]
                })
                .collect();
            Curve::line(format!("{salinity} ‰"), points)
        })
        .collect();
    chapter.charts.push(Chart {
        name: "water".to_owned(),
        title: format!("Δv of the joint solution by temperature and salinity (Quan and Fry, {WAVELENGTH_NM} nm)"),
        x: "temperature, °C".to_owned(),
        y: "Δv, mm".to_owned(),
        curves,
    });
    let delta_v = |temperature: f64, salinity: f64| {
        let mut changed = *design;
        changed.shell.n_water = index(temperature, salinity);
        changed.joint(l_bound).delta_v
    };
    chapter.findings.push(Finding::new(
        "Δv from fresh water at 20 °C to sea water (35 ‰) at 10 °C",
        format!("{:+.1} µm", 1000.0 * (delta_v(10.0, 35.0) - delta_v(20.0, 0.0))),
        "the tolerance of Δv is 5 µm: a camera aligned in a tank is aligned again for the sea, or its target is set for it",
    ));
}

/// The spacing across the field, for pairs along the radius and across it.
fn curvature(chapter: &mut Chapter, design: &CameraDesign, pixel: f64) -> Result<(), StudyError> {
    let mut curves = Vec::new();
    let mut table = Table::new(
        "curvature",
        "Rise of the exact spacing over that on the axis, px",
        &[
            "e, mm",
            "2 mm off the axis, pairs along the radius",
            "2 mm, pairs across it",
            "corner (2.83 mm), along",
            "corner, across",
        ],
    );
    for e in [0.0, 30.0] {
        let view = design.exact_in_water(design.clarity(e).delta_v, e);
        let at = |field: f64, direction: [f64; 2]| {
            // The field is given on the sensor; pairs lie on the MLA.
            let on_mla = field * view.lens_to_mla / (view.lens_to_mla + view.b);
            let off = view.spacing([on_mla, 0.0], direction, [0.0; 2], [0.0; 2])?;
            Some((off - view.chief_pair_spacing()?) / pixel)
        };
        for (name, direction) in [("along", [1.0, 0.0]), ("across", [0.0, 1.0])] {
            let points =
                (0..=60).filter_map(|k| Some([0.05 * f64::from(k), at(0.05 * f64::from(k), direction)?])).collect();
            curves.push(Curve::line(format!("e = {e} mm, pairs {name} the radius"), points));
        }
        let cell = |field: f64, direction: [f64; 2]| {
            at(field, direction)
                .map(|rise| format!("{rise:+.3}"))
                .ok_or_else(|| StudyError::unseen("the field's curvature", "beyond the shell's rim"))
        };
        table.push([
            format!("{e:.0}"),
            cell(2.0, [1.0, 0.0])?,
            cell(2.0, [0.0, 1.0])?,
            cell(2.828, [1.0, 0.0])?,
            cell(2.828, [0.0, 1.0])?,
        ]);
    }
    chapter.tables.push(table);
    chapter.charts.push(Chart {
        name: "curvature".to_owned(),
        title: "Curvature of the field behind the shell".to_owned(),
        x: "distance from the axis on the sensor, mm".to_owned(),
        y: "spacing less that on the axis, px".to_owned(),
        curves,
    });
    chapter.text.push(
        "The criterion of Eq. 16 is paraxial. A flat board through a concentric shell has a curved virtual image: the \
         spacing rises towards the edge, so that a mean over the frame is not the spacing on the axis. The estimator fits \
         the curvature and uses the value on the axis."
            .to_owned(),
    );
    Ok(())
}

/// A shell whose centre is beside the axis.
fn decentre(chapter: &mut Chapter, design: &CameraDesign, l_bound: f64, pixel: f64) {
    let joint = design.joint(l_bound);
    let mut table = Table::new(
        "decentre",
        "A shell beside the axis: what the spacing shows, and the centre of its field",
        &[
            "e, mm",
            "decentre, mm",
            "spacing on the axis, change in px",
            "tilt, px per mm of sensor",
            "centre of the field, mm beside the axis",
        ],
    );
    for e in [joint.e, 30.0] {
        let delta_v = design.clarity(e).delta_v;
        let spacing = |decentre: f64, field: f64| {
            let medium = Medium::Water { shell: design.shell, e, decentre: [decentre, 0.0] };
            let camera = CameraTruth::from_design(design, delta_v, medium, pixel, 1161, 1161);
            let tracer = Tracer::new(&camera);
            let board = Board::new(design.object_distance, Arc::new(TextureMap::from_values(&[0.0], 1.0)));
            let lens = tracer.microlens_at(camera.frame_from_sensor([field, 0.0]));
            // A pair across x, both lenses alike far along it: the tilt along x without the pair's own length.
            let next = tracer.step(lens, 0, 1);
            let centre = tracer.micro_image_centre(lens);
            let point = tracer.board_point(&board, lens, [centre[0], centre[1] + 5.0], [0.0; 2])?;
            Some((tracer.spacing(&board, [lens, next], point)?, centre[0]))
        };
        let Some((on_axis, _)) = spacing(0.0, 0.0) else { continue };
        for by in [0.0, 0.2, 0.5, 1.0, 2.0] {
            let (Some(middle), Some(left), Some(right)) = (spacing(by, 0.0), spacing(by, -1.5), spacing(by, 1.5))
            else {
                continue;
            };
            let apart = (right.1 - left.1) * pixel;
            let tilt = (right.0 - left.0) / apart;
            let bend = (right.0 - 2.0 * middle.0 + left.0) / (0.25 * apart * apart);
            table.push([
                format!("{e:.0}"),
                format!("{by:.1}"),
                format!("{:+.4}", middle.0 - on_axis),
                format!("{tilt:+.4}"),
                format!("{:+.2}", -tilt / bend),
            ]);
        }
    }
    chapter.tables.push(table);
    chapter.text.push(
        "Section 2.2 takes shell and camera as coaxial. A shell beside the axis hardly moves the spacing on the axis but \
         moves the centre of the curved field: to the estimator that is a tilt. It must not be mended by tilting the lens \
         before the board has been turned by 180° or seen at a second distance."
            .to_owned(),
    );
}
