//! `--shard slurm`: which part a task of a Slurm array is to work out, and on how many processors.
//!
//! Slurm's variables are read where they are asked for and nowhere else: an array of somebody else's may mean something
//! else by its tasks.

use std::num::NonZeroUsize;

use anyhow::{Context as _, anyhow, bail, ensure};

use crate::study::Shard;

/// A variable of the environment, by its name.
type Variable<'a> = &'a dyn Fn(&str) -> Option<String>;

/// The part of this task: the array's tasks are all the parts, counted from 0 or from 1.
///
/// # Errors
/// Where a variable is not set or not a number, or where the array's tasks are not all the parts.
pub(super) fn shard(variable: Variable<'_>) -> anyhow::Result<Shard> {
    let whole = "--shard slurm is for a task of an array that has all the parts, such as sbatch --array=1-8";
    let set = |name: &str| {
        let text = variable(name).ok_or_else(|| anyhow!("{name} is not set: {whole}; elsewhere it is --shard K/N"))?;
        text.trim().parse::<u64>().map_err(|_| anyhow!("{name} is \"{text}\", and has to be a whole number: {whole}"))
    };
    let id = set("SLURM_ARRAY_TASK_ID")?;
    let [count, min, max] = ["COUNT", "MIN", "MAX"].map(|name| set(&format!("SLURM_ARRAY_TASK_{name}")));
    let (count, min, max) = (count?, min?, max?);
    // An array that is a list has none of its own in some versions.
    let step = match variable("SLURM_ARRAY_TASK_STEP") {
        Some(_) => set("SLURM_ARRAY_TASK_STEP")?,
        None => 1,
    };
    ensure!(
        (min..=max).contains(&id),
        "SLURM_ARRAY_TASK_ID is {id}, which is no task of {min}-{max} (SLURM_ARRAY_TASK_MIN and _MAX): {whole}"
    );
    let alone = "parts that are to be done again alone are told how many there are: SHARDS and FIRST of slurm-parts.sh, or \
                 --shard K/N";
    ensure!(
        step == 1,
        "the array has gaps: SLURM_ARRAY_TASK_STEP is {step}, so that it does not say how many parts there are: {whole}; {alone}"
    );
    let tasks = (max - min).saturating_add(1);
    if count != tasks {
        bail!(
            "the array has gaps: SLURM_ARRAY_TASK_COUNT is {count}, and {min}-{max} (SLURM_ARRAY_TASK_MIN and _MAX) would be \
             {tasks}, so that it does not say how many parts there are: {whole}; {alone}"
        );
    }
    ensure!(
        min <= 1,
        "SLURM_ARRAY_TASK_MIN is {min}, and has to be 0 or 1, so that the array does not say how many parts there are: \
         {whole}; {alone}"
    );
    format!("{}/{count}", (id - min).saturating_add(1)).parse().map_err(|why: String| anyhow!(why))
}

/// As many threads as this task was given processors, unless `RAYON_NUM_THREADS` says otherwise; `None` where Slurm does not
/// say.
///
/// # Errors
/// Where the variable is no number of processors.
pub(super) fn threads(variable: Variable<'_>) -> anyhow::Result<Option<NonZeroUsize>> {
    // What is no number of threads is not looked at by those who are told it, either.
    if variable("RAYON_NUM_THREADS").is_some_and(|text| text.parse::<NonZeroUsize>().is_ok()) {
        return Ok(None);
    }
    // The first is set where processors were asked for by the task.
    let given =
        ["SLURM_CPUS_PER_TASK", "SLURM_CPUS_ON_NODE"].into_iter().find_map(|name| Some((name, variable(name)?)));
    let Some((name, text)) = given else { return Ok(None) };
    let threads = text.trim().parse().with_context(|| format!("{name} is \"{text}\", and has to be 1 or more"))?;
    Ok(Some(threads))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The variables, each by the end of its name, as Slurm 22.05 sets them for an array.
    fn told(variables: &[(&str, &str)]) -> Result<String, String> {
        let variable = |name: &str| {
            let end = name.strip_prefix("SLURM_ARRAY_TASK_")?;
            variables.iter().find(|(other, _)| *other == end).map(|(_, value)| (*value).to_owned())
        };
        shard(&variable).map(|shard| shard.to_string()).map_err(|error| error.to_string())
    }

    fn array(id: &str, count: &str, min: &str, max: &str, step: &str) -> Result<String, String> {
        told(&[("ID", id), ("COUNT", count), ("MIN", min), ("MAX", max), ("STEP", step)])
    }

    #[test]
    fn a_task_of_a_whole_array_is_its_part() {
        for (id, count, min, max, step, part) in [
            ("1", "8", "1", "8", "1", "1/8"),
            ("8", "8", "1", "8", "1", "8/8"),
            ("0", "8", "0", "7", "1", "1/8"),
            ("7", "8", "0", "7", "1", "8/8"),
            ("1", "1", "1", "1", "1", "1/1"),
        ] {
            assert_eq!(array(id, count, min, max, step).as_deref(), Ok(part));
        }
        let without_step = told(&[("ID", "2"), ("COUNT", "2"), ("MIN", "1"), ("MAX", "2")]);
        assert_eq!(without_step.as_deref(), Ok("2/2"));
    }

    #[test]
    fn what_is_wrong_names_its_variable_and_what_would_be_right() {
        for (said, says) in [
            (told(&[]), "SLURM_ARRAY_TASK_ID is not set"),
            (told(&[("ID", "1")]), "SLURM_ARRAY_TASK_COUNT is not set"),
            (array("x", "8", "1", "8", "1"), "SLURM_ARRAY_TASK_ID is \"x\", and has to be a whole number"),
            (array("1", "8", "1", "-8", "1"), "SLURM_ARRAY_TASK_MAX is \"-8\""),
            (array("1", "8", "1", "8", "0"), "SLURM_ARRAY_TASK_STEP is 0"),
            (array("9", "8", "1", "8", "1"), "SLURM_ARRAY_TASK_ID is 9, which is no task of 1-8 "),
            (array("3", "2", "1", "3", "2"), "the array has gaps: SLURM_ARRAY_TASK_STEP is 2"),
            // As 22.05 sets them for --array=3,7 and for --array=1,3,5.
            (array("7", "2", "3", "7", "1"), "the array has gaps: SLURM_ARRAY_TASK_COUNT is 2, and 3-7"),
            (array("3", "3", "1", "5", "1"), "the array has gaps: SLURM_ARRAY_TASK_COUNT is 3, and 1-5"),
            (array("3", "3", "2", "4", "1"), "SLURM_ARRAY_TASK_MIN is 2, and has to be 0 or 1"),
        ] {
            let error = said.unwrap_err();
            assert!(error.contains(says) && error.contains("sbatch --array=1-8"), "{says}: {error}");
        }
    }

    #[test]
    fn there_are_as_many_threads_as_processors_were_given() {
        let threads = |variables: &[(&str, &str)]| {
            let variable =
                |name: &str| variables.iter().find(|(other, _)| *other == name).map(|(_, value)| (*value).to_owned());
            threads(&variable).map(|threads| threads.map(NonZeroUsize::get)).map_err(|error| error.to_string())
        };
        assert_eq!(threads(&[("SLURM_CPUS_PER_TASK", "4"), ("SLURM_CPUS_ON_NODE", "8")]), Ok(Some(4)));
        assert_eq!(threads(&[("SLURM_CPUS_ON_NODE", "1")]), Ok(Some(1)));
        assert_eq!(threads(&[]), Ok(None));
        assert_eq!(threads(&[("RAYON_NUM_THREADS", "2"), ("SLURM_CPUS_PER_TASK", "4")]), Ok(None));
        for nothing in ["", "0", "x"] {
            assert_eq!(threads(&[("RAYON_NUM_THREADS", nothing), ("SLURM_CPUS_PER_TASK", "4")]), Ok(Some(4)));
        }
        let wrong = threads(&[("SLURM_CPUS_PER_TASK", "0")]).unwrap_err();
        assert!(wrong.contains("SLURM_CPUS_PER_TASK is \"0\", and has to be 1 or more"), "{wrong}");
    }
}
