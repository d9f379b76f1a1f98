//! Telling a controller's lines apart.

use super::{Alarm, DUMP, Dialect, banner, version, without_echo};
use crate::device::port::{Kind, LineBuffer, Protocol, Recovery};

/// Tells the lines of Grbl and its heirs apart; which of them it is, the lines say themselves.
#[derive(Debug, Default)]
pub struct Grbl {
    buffer: LineBuffer,
    dialect: Dialect,
}

impl Protocol for Grbl {
    type Message = String;
    const RECOVERY: Recovery = Recovery::Required;
    const URGENT_ANYWHERE: bool = true;

    fn frame(&mut self, bytes: &[u8]) -> Vec<String> {
        let lines = self.buffer.push(bytes);
        for line in &lines {
            let told = banner(line).or_else(|| version(std::slice::from_ref(line)));
            // The version alone does not say grblHAL, whose numbers are Grbl's here.
            self.dialect = told.map_or(self.dialect, |told| told.dialect);
        }
        lines
    }

    fn classify(&self, line: &String, request: Option<&[u8]>) -> Kind {
        let line = without_echo(line);
        if line == "ok" {
            Kind::Done
        } else if line.starts_with("error:") {
            Kind::Refused
        } else if let Some(alarm) = Alarm::from_line(line, self.dialect) {
            // FluidNC says after its start that it is not homed: nothing is halted by that.
            if alarm.is_unhomed() { Kind::Notice } else { Kind::Halted }
        } else if line.starts_with("ALARM:") {
            Kind::Halted
        } else if banner(line).is_some() {
            Kind::Started
        } else if line.starts_with('<') || line.starts_with("[MSG:") {
            Kind::Notice
        } else if line.starts_with('$') || line.starts_with('[') || request == Some(DUMP) {
            Kind::Data
        } else {
            Kind::Noise
        }
    }

    fn text(&self, line: &String) -> String {
        line.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_are_told_apart() {
        let kind = |line: &str| Grbl::default().classify(&line.to_owned(), None);
        assert_eq!(kind("ok"), Kind::Done);
        assert_eq!(kind("error:15"), Kind::Refused);
        assert_eq!(kind("ALARM:1"), Kind::Halted);
        assert_eq!(kind("Grbl 1.1h ['$' for help]"), Kind::Started);
        assert_eq!(kind("\u{fffd}xGrbl 1.1h ['$' for help]"), Kind::Started);
        assert_eq!(kind("GrblHAL 1.1f ['$' or '$HELP' for help]"), Kind::Started);
        assert_eq!(kind("Grbl something else"), Kind::Noise);
        assert_eq!(kind("?<Idle|MPos:0,0,0>"), Kind::Notice, "an echo of what was asked");
        assert_eq!(kind("<Idle|MPos:0,0,0>"), Kind::Notice);
        assert_eq!(kind("[MSG:Reset to continue]"), Kind::Notice);
        assert_eq!(kind("$100=400.000"), Kind::Data);
        assert_eq!(kind("[VER:1.1h.20190825:]"), Kind::Data);
        assert_eq!(kind("\u{fffd}"), Kind::Noise);
    }

    #[test]
    fn fluidncs_dump_answers_its_question_only_and_its_chatter_answers_none() {
        let mut grbl = Grbl::default();
        let kind = |grbl: &Grbl, line: &str, request| grbl.classify(&line.to_owned(), request);
        assert_eq!(kind(&grbl, "ALARM:14", None), Kind::Halted, "not FluidNC's, as far as is known");
        grbl.frame(b"Grbl 3.9 [FluidNC v3.9.1 (wifi) '$' for help]\r\n");
        assert_eq!(kind(&grbl, "Grbl 3.9 [FluidNC v3.9.1 (wifi) '$' for help]", None), Kind::Started);
        assert_eq!(kind(&grbl, "ALARM:14", None), Kind::Notice);
        assert_eq!(kind(&grbl, "ALARM:1", None), Kind::Halted);
        assert_eq!(kind(&grbl, "[MSG:INFO: Machine bench]", Some(DUMP)), Kind::Notice);
        assert_eq!(kind(&grbl, "<Idle|MPos:0.000,0.000|FS:0,0>", Some(DUMP)), Kind::Notice);
        for line in ["axes: ", "      positive_direction: false"] {
            assert_eq!(kind(&grbl, line, Some(DUMP)), Kind::Data);
            assert_eq!(kind(&grbl, line, None), Kind::Noise);
        }
        let mut asked = Grbl::default();
        asked.frame(b"[VER:3.9 FluidNC v3.9.1:]\n");
        assert_eq!(kind(&asked, "ALARM:14", None), Kind::Notice);
    }
}
