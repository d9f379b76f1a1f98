//! Who has the lease, until when, and what a key opens.

use super::*;

fn request(owner: &str) -> LeaseRequest {
    LeaseRequest { owner: owner.into(), note: None, ttl: Duration::from_secs(30) }
}

async fn pass(seconds: u64) {
    tokio::time::advance(Duration::from_secs(seconds)).await;
}

#[tokio::test(start_paused = true)]
async fn one_holds_it_until_it_runs_out() {
    let leases = Leases::default();
    let grant = leases.acquire(request("ada")).unwrap();
    let refused = leases.acquire(request("bob")).unwrap_err();
    assert_eq!(refused, Refusal::LeaseHeld { owner: "ada".into(), note: None, job: None });
    assert_eq!(leases.permit(Some(&grant.key)).unwrap().owner(), "ada");
    assert_eq!(leases.permit(None), Err(Refusal::LeaseRequired));
    assert_eq!(leases.permit(Some("guess")), Err(Refusal::LeaseLost { holder: Some("ada".into()) }));

    pass(29).await;
    leases.renew(Some(&grant.key)).unwrap();
    pass(29).await;
    assert!(leases.permit(Some(&grant.key)).is_ok());
    pass(2).await;
    assert_eq!(leases.permit(Some(&grant.key)), Err(Refusal::LeaseLost { holder: None }));
    assert!(leases.view().is_none());
    leases.acquire(request("bob")).unwrap();
    let owners = |ended: Vec<LeaseView>| ended.into_iter().map(|lease| lease.owner).collect::<Vec<_>>();
    assert_eq!(owners(leases.take_run_out()), ["ada"]);
    leases.take_over(request("admin"));
    assert_eq!(owners(leases.take_run_out()), [""; 0], "taken over is not run out, and told once is enough");
}

#[tokio::test(start_paused = true)]
async fn a_connection_holds_it_and_leaves_ten_seconds() {
    let leases = Leases::default();
    let grant = leases.acquire(request("ada")).unwrap();
    let permit = leases.connect(&grant.key).unwrap();
    pass(600).await;
    assert_eq!(leases.view().unwrap().expires_at, None);
    leases.disconnect(&permit);
    pass(9).await;
    let again = leases.connect(&grant.key).unwrap();
    pass(600).await;
    leases.disconnect(&again);
    pass(11).await;
    assert!(leases.view().is_none());
}

#[tokio::test(start_paused = true)]
async fn a_job_holds_it_without_a_heartbeat_and_gives_it_back() {
    let leases = Leases::default();
    let grant = leases.acquire(request("ada")).unwrap();
    let permit = leases.permit(Some(&grant.key)).unwrap();
    let job = Uuid::now_v7();
    leases.bind(&permit, job).unwrap();
    pass(3600).await;
    assert_eq!(leases.view().unwrap().job, Some(job));
    let refused = leases.acquire(request("bob")).unwrap_err();
    assert_eq!(refused, Refusal::LeaseHeld { owner: "ada".into(), note: None, job: Some(job) });
    leases.renew(Some(&grant.key)).unwrap();
    leases.unbind(job);
    assert!(leases.permit(Some(&grant.key)).is_ok());
    leases.bind(&permit, job).unwrap();
    pass(31).await;
    leases.unbind(job);
    pass(9).await;
    assert!(leases.permit(Some(&grant.key)).is_ok(), "nobody renewed it meanwhile, but ten seconds are left");
    pass(2).await;
    assert!(leases.view().is_none());
    leases.acquire(request("ada")).unwrap();
}

#[tokio::test(start_paused = true)]
async fn taken_over_the_former_key_is_dead_at_once_a_jobs_too() {
    let leases = Leases::default();
    let former = leases.acquire(request("ada")).unwrap();
    let permit = leases.permit(Some(&former.key)).unwrap();
    leases.bind(&permit, Uuid::now_v7()).unwrap();
    leases.check(&permit).unwrap();
    let grant = leases.take_over(request("admin"));
    let lost = Refusal::LeaseLost { holder: Some("admin".into()) };
    assert_eq!(leases.permit(Some(&former.key)), Err(lost.clone()));
    assert_eq!(leases.check(&permit), Err(lost));
    assert!(leases.permit(Some(&grant.key)).is_ok());
    assert!(!serde_json::to_string(&leases.keep()).unwrap().contains(&grant.key), "the key is not kept");
}

#[tokio::test(start_paused = true)]
async fn given_back_it_is_free_at_once_or_at_the_jobs_end() {
    let leases = Leases::default();
    let grant = leases.acquire(request("ada")).unwrap();
    assert_eq!(leases.release(None), Err(Refusal::LeaseRequired));
    leases.release(Some("another's")).unwrap();
    assert!(leases.view().is_some());
    let permit = leases.permit(Some(&grant.key)).unwrap();
    let job = Uuid::now_v7();
    leases.bind(&permit, job).unwrap();
    leases.release(Some(&grant.key)).unwrap();
    assert_eq!(leases.view().unwrap().job, Some(job));
    leases.unbind(job);
    assert!(leases.view().is_none());
    assert_eq!(leases.take_run_out(), [], "it was given back");
    leases.release(Some(&grant.key)).unwrap();
}

#[tokio::test(start_paused = true)]
async fn given_back_under_a_job_it_ends_with_that_whatever_is_asked() {
    let leases = Leases::default();
    let grant = leases.acquire(request("ada")).unwrap();
    let permit = leases.permit(Some(&grant.key)).unwrap();
    let job = Uuid::now_v7();
    leases.bind(&permit, job).unwrap();
    leases.release(Some(&grant.key)).unwrap();
    let lost = Refusal::LeaseLost { holder: Some("ada".into()) };
    assert_eq!(leases.renew(Some(&grant.key)), Err(lost.clone()), "a heartbeat on its way is no word to keep it");
    assert_eq!(leases.connect(&grant.key), Err(lost));
    assert!(leases.permit(Some(&grant.key)).is_ok(), "until then its key is the job's");
    assert!(leases.keep().is_none(), "a restart ends the job, and it with that");
    leases.unbind(job);
    assert!(leases.view().is_none() && leases.permit(Some(&grant.key)).is_err());
    assert_eq!(leases.take_run_out(), []);
}

#[tokio::test(start_paused = true)]
async fn it_survives_a_restart_for_what_it_had_left() {
    let leases = Leases::default();
    let grant = leases.acquire(request("ada")).unwrap();
    let kept = leases.keep().unwrap();
    let after = Leases::default();
    after.restore(kept.clone());
    assert!(after.permit(Some(&grant.key)).is_ok());
    assert!(after.acquire(request("bob")).is_err());
    pass(31).await;
    assert!(after.view().is_none());
    // A file that is opened again does not bring back what was given back meanwhile.
    let again = Leases::default();
    again.restore(kept.clone());
    again.release(Some(&grant.key)).unwrap();
    again.restore(kept.clone());
    assert!(again.view().is_none() && again.permit(Some(&grant.key)).is_err());
    let late = Leases::default();
    late.restore(KeptLease { expires_at: jiff::Timestamp::UNIX_EPOCH, ..kept });
    assert!(late.view().is_none());
    assert_eq!(late.take_run_out().len(), 1, "it ran out while the program did not run");
}
