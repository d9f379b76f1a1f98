//! What a camera is set by, and how it is set.

use super::*;

fn control(name: &str, kind: ControlKind) -> Control {
    Control {
        key: key_of(name),
        name: name.to_owned(),
        kind,
        minimum: 0,
        maximum: 255,
        step: 5,
        default: 0,
        value: Some(0),
        items: vec![(0, "Auto Mode".to_owned()), (2, "Manual Mode".to_owned())],
        locked: None,
        id: 1,
        flags: 0,
    }
}

#[test]
fn a_value_is_kept_before_it_is_set_and_no_longer_where_it_is_refused() {
    let kept = KeptControls::default();
    let now = || kept.lock().unwrap().get("gain").cloned();
    let set = |number, refused: bool| {
        keep_while(&kept, "gain".to_owned(), ControlValue::Number(number), || {
            assert_eq!(now(), Some(ControlValue::Number(number)));
            if refused { Err("no".to_owned()) } else { Ok(()) }
        })
    };
    assert!(set(3, true).is_err() && now().is_none());
    assert!(set(3, false).is_ok() && set(7, true).is_err());
    assert_eq!(now(), Some(ControlValue::Number(3)));
}

#[test]
fn keys_are_as_v4l2_ctl_makes_them() {
    assert_eq!(key_of("Exposure Time, Absolute"), "exposure_time_absolute");
    assert_eq!(key_of("White Balance, Automatic"), "white_balance_automatic");
    assert_eq!(key_of("gain"), "gain");
    assert_eq!(key_of(" 50/60 Hz! "), "50_60_hz");
}

#[test]
fn values_are_taken_or_refused_with_the_choices() {
    let (number, item) = (ControlValue::Number, |name: &str| ControlValue::Item(name.to_owned()));
    let gain = control("Gain", ControlKind::Number);
    assert_eq!(gain.number_of(&number(250)), Ok(250));
    for wrong in [number(256), number(-5), number(7), item("high"), ControlValue::Switch(true)] {
        let refused = gain.number_of(&wrong).unwrap_err();
        assert!(refused.contains("`gain` cannot be") && refused.contains("0 to 255 in steps of 5"), "{refused}");
    }
    let mode = control("Auto Exposure", ControlKind::Menu);
    assert_eq!(mode.number_of(&number(2)), Ok(2));
    assert_eq!(mode.number_of(&item("manual mode")), Ok(2));
    let refused = mode.number_of(&number(1)).unwrap_err();
    assert!(refused.contains("0 \"Auto Mode\", 2 \"Manual Mode\""), "{refused}");
    let switch = control("Autogain", ControlKind::Switch);
    assert_eq!(switch.number_of(&ControlValue::Switch(true)), Ok(1));
    assert_eq!(switch.number_of(&number(0)), Ok(0));
    assert!(switch.number_of(&number(2)).unwrap_err().contains("true or false"));
    let bits = Control { maximum: 0x0f, ..control("Mask", ControlKind::Bits) };
    assert_eq!(bits.number_of(&number(0x0a)), Ok(0x0a));
    assert!(bits.number_of(&number(0x10)).unwrap_err().contains("0x0 to 0xf"));
}

#[test]
fn an_unknown_control_is_named_with_those_there_are() {
    let controls = [control("Gain", ControlKind::Number), control("Autogain", ControlKind::Switch)];
    let refused = choose(&controls, "gian", &ControlValue::Number(0)).unwrap_err();
    assert!(refused.contains("`gian`") && refused.contains("it has gain, autogain"), "{refused}");
    assert_eq!(choose(&controls, "Gain", &ControlValue::Number(5)).unwrap().1, 5);
    assert!(choose(&[], "gain", &ControlValue::Number(0)).unwrap_err().contains("it has none"));
}

fn numbered(id: u32, name: &str, [minimum, maximum, step, default, value]: [i64; 5]) -> Control {
    let step = step.unsigned_abs();
    Control { id, minimum, maximum, step, default, value: Some(value), ..control(name, ControlKind::Number) }
}

#[test]
fn exposure_and_gain_are_told_in_their_units() {
    // As a UVC camera lists them.
    let controls = [
        numbered(V4L2_CID_GAIN, "Gain", [0, 480, 10, 0, 40]),
        numbered(V4L2_CID_EXPOSURE_ABSOLUTE, "Exposure Time, Absolute", [1, 5000, 1, 156, 333]),
    ];
    let light: Vec<LightControl> = light_of(&controls).into_iter().map(|(told, ..)| told).collect();
    let [exposure, gain] = &light[..] else { panic!("{light:?}") };
    // 333 times 100 µs.
    assert_eq!((exposure.name, exposure.unit, exposure.value), (ControlName::Exposure, ControlUnit::Ms, Some(33.3)));
    let limits = (exposure.minimum, exposure.maximum, exposure.step, exposure.default);
    assert_eq!(limits, (0.1, 500.0, 0.1, 15.6));
    assert_eq!((exposure.key.as_str(), exposure.automatic), ("exposure_time_absolute", false));
    assert_eq!((gain.name, gain.unit, gain.value), (ControlName::Gain, ControlUnit::Driver, Some(40.0)));
    assert_eq!((gain.minimum, gain.maximum, gain.step, &gain.locked), (0.0, 480.0, 10.0, &None));
    // And back: every number that the driver takes is told by one that comes to it again.
    for number in 1..=5000 {
        let told = exposure.nearest(number as f64 / 10.0).unwrap();
        assert_eq!((told * 10.0).round() as i64, number);
    }
}

#[test]
fn what_a_camera_adjusts_by_itself_is_not_set() {
    let exposure = |value| {
        let absolute = numbered(V4L2_CID_EXPOSURE_ABSOLUTE, "Exposure Time, Absolute", [1, 5000, 1, 156, 333]);
        let auto = Control {
            id: V4L2_CID_EXPOSURE_AUTO,
            value: Some(value),
            items: vec![(1, "Manual Mode".to_owned()), (3, "Aperture Priority Mode".to_owned())],
            ..control("Auto Exposure", ControlKind::Menu)
        };
        light_of(&[auto, Control { locked: (value != 1).then_some("inactive"), ..absolute }])[0].0.clone()
    };
    let by_hand = exposure(1);
    assert_eq!((by_hand.automatic, by_hand.locked), (false, None));
    let by_itself = exposure(3);
    let why = by_itself.locked.unwrap();
    assert!(by_itself.automatic && why.contains("`auto_exposure` is 3 \"Aperture Priority Mode\""), "{why}");
}

#[test]
fn a_driver_without_absolute_exposure_tells_its_own_numbers() {
    let controls = [
        numbered(V4L2_CID_EXPOSURE, "Exposure", [4, 3000, 1, 1000, 800]),
        numbered(V4L2_CID_ANALOGUE_GAIN, "Analogue Gain", [16, 248, 1, 16, 16]),
        numbered(V4L2_CID_GAIN, "Gain", [0, 10, 1, 0, 0]),
    ];
    let light = light_of(&controls);
    assert_eq!((light[0].0.unit, light[0].0.value), (ControlUnit::Driver, Some(800.0)));
    assert_eq!((light.len(), light[1].0.key.as_str()), (2, "analogue_gain"), "the better one of two");
    assert!(light_of(&[control("Brightness", ControlKind::Number)]).is_empty());
}
