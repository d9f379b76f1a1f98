//! What a request asks: parameters of a query or a form, and who asks.

use std::net::IpAddr;
use std::str::FromStr;

use super::fault::Refused;
use crate::control::motion::Stops;

/// How a member is asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verb {
    Get,
    Put,
}

/// How a member may be asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verbs {
    Get,
    Put,
    Both,
}

impl Verbs {
    pub(super) fn allow(self, verb: Verb) -> bool {
        self == Self::Both || (self == Self::Get) == (verb == Verb::Get)
    }

    /// As the header `Allow` has it.
    pub(super) const fn names(self) -> &'static str {
        match self {
            Self::Get => "GET",
            Self::Put => "PUT",
            Self::Both => "GET, PUT",
        }
    }
}

/// Who asks: one ClientID at one address.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub(super) struct Caller {
    /// 0 where none is told.
    pub(super) id: u32,
    pub(super) address: IpAddr,
}

impl Caller {
    /// Its name in the lease and in the audit log.
    pub(super) fn name(&self) -> String {
        format!("alpaca:{}", self.id)
    }
}

/// A member of a device, asked for.
#[derive(Debug)]
pub(super) struct Call {
    pub(super) verb: Verb,
    pub(super) member: &'static str,
    pub(super) params: Params,
    pub(super) caller: Caller,
    /// The stops when the request's head had come: its form may take its time.
    pub(super) asked: Stops,
}

/// Named values, of a query or a form.
#[derive(Debug)]
pub(super) struct Params {
    pairs: Vec<(String, String)>,
    /// Whether their names' case counts, as in a form.
    exact: bool,
}

fn pairs(bytes: &[u8]) -> Vec<(String, String)> {
    form_urlencoded::parse(bytes).into_owned().collect()
}

impl Params {
    /// Those of a query, by names in any case.
    pub(super) fn of_query(query: &str) -> Self {
        Self { pairs: pairs(query.as_bytes()), exact: false }
    }

    /// Those of a form, by their exact names.
    pub(super) fn of_form(body: &[u8]) -> Self {
        Self { pairs: pairs(body), exact: true }
    }

    fn get(&self, name: &str) -> Option<&str> {
        let is = |found: &str| if self.exact { found == name } else { found.eq_ignore_ascii_case(name) };
        self.pairs.iter().find(|(found, _)| is(found)).map(|(_, value)| value.as_str())
    }

    /// A text that has to be there.
    pub(super) fn text(&self, name: &str) -> Result<&str, Refused> {
        self.get(name).ok_or_else(|| {
            let near = self.pairs.iter().find(|(found, _)| found.eq_ignore_ascii_case(name));
            let near = near.map(|(found, _)| format!("; {found:?} is not its name")).unwrap_or_default();
            Refused::Malformed(format!("the parameter {name} is missing{near}"))
        })
    }

    fn read<T: FromStr>(&self, name: &str, what: &str) -> Result<T, Refused> {
        let text = self.text(name)?;
        text.trim().parse().map_err(|_| Refused::Malformed(format!("{name}: {text:?} is no {what}")))
    }

    /// A whole number.
    pub(super) fn int(&self, name: &str) -> Result<i32, Refused> {
        self.read(name, "whole number of 32 bits")
    }

    /// A number.
    pub(super) fn number(&self, name: &str) -> Result<f64, Refused> {
        let number: f64 = self.read(name, "number")?;
        if number.is_finite() { Ok(number) } else { Err(Refused::Malformed(format!("{name}: {number} is no number"))) }
    }

    /// `True` or `False`, in any case.
    pub(super) fn flag(&self, name: &str) -> Result<bool, Refused> {
        let text = self.text(name)?.trim();
        if text.eq_ignore_ascii_case("true") {
            Ok(true)
        } else if text.eq_ignore_ascii_case("false") {
            Ok(false)
        } else {
            Err(Refused::Malformed(format!("{name}: {text:?} is neither True nor False")))
        }
    }

    /// ClientID or ClientTransactionID: 0 where it is not told.
    pub(super) fn id(&self, name: &str) -> Result<u32, Refused> {
        match self.get(name) {
            None => Ok(0),
            Some(_) => self.read(name, "whole number of 0 to 4294967295"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_querys_names_come_in_any_case_and_a_forms_do_not() {
        let query = Params::of_query("clientid=7&CLIENTTRANSACTIONID=8&connected=TRUE");
        assert_eq!((query.id("ClientID"), query.id("ClientTransactionID")), (Ok(7), Ok(8)));
        assert_eq!(query.flag("Connected"), Ok(true));
        let form = Params::of_form(b"clientid=7&ClientTransactionID=8&connected=true");
        assert_eq!((form.id("ClientID"), form.id("ClientTransactionID")), (Ok(0), Ok(8)));
        let Err(Refused::Malformed(words)) = form.flag("Connected") else { panic!("it was found") };
        assert!(words.contains("Connected is missing") && words.contains("\"connected\""), "{words}");
    }

    #[test]
    fn what_is_no_value_of_its_kind_is_malformed() {
        for text in ["", "-1", "4294967296", "seven", "1.5", "0x7"] {
            assert!(Params::of_query(&format!("ClientID={text}")).id("ClientID").is_err(), "{text}");
        }
        for text in ["", "yes", "1", "truth"] {
            assert!(Params::of_form(format!("Light={text}").as_bytes()).flag("Light").is_err(), "{text}");
        }
        for text in ["", "2147483648", "1.0", "1e3", "far"] {
            assert!(Params::of_form(format!("Position={text}").as_bytes()).int("Position").is_err(), "{text}");
        }
        for text in ["", "NaN", "inf", "1,5", "long"] {
            assert!(Params::of_form(format!("Duration={text}").as_bytes()).number("Duration").is_err(), "{text}");
        }
        assert_eq!(Params::of_form(b"Duration=1.5e-2").number("Duration"), Ok(0.015));
        assert_eq!(Params::of_form(b"Position=-10").int("Position"), Ok(-10));
    }
}
