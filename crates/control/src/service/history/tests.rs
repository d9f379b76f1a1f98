//! How long a bench takes for what it has done before.

use super::*;
use crate::events::Event;
use crate::job::JobState;
use crate::motion::lease::LeaseRequest;
use crate::open_bench;
use bench::config::{Config, ConfigOrigin};
use bench::device::AxisName;
use bench::store::Store;

#[tokio::test(start_paused = true)]
async fn only_the_same_request_that_came_to_its_end_tells_how_long_one_takes() {
    let config = Arc::new(Config::default());
    let bench = open_bench(&config).await.unwrap();
    let service = Service::start(config, "a test's configuration".to_owned(), bench, Store::in_memory());
    let request = LeaseRequest { owner: "a test".to_owned(), note: None, ttl: Duration::from_secs(3600) };
    let grant = service.leases().acquire(request).unwrap();
    let permit = service.leases().permit(Some(&grant.key)).unwrap();
    let mut events = service.subscribe();
    let homing = JobRequest::of(JobKind::Homing);
    let noted = JobRequest { note: Some("once more".to_owned()), ..homing.clone() };
    let focus = JobRequest { axes: Some(vec![AxisName::Focus]), ..homing.clone() };
    for (cancelled, known) in [(true, false), (false, true)] {
        let id = service.create_job(&permit, homing.clone()).await.unwrap().id;
        if cancelled {
            service.cancel(id, None).unwrap();
        }
        while !matches!(events.recv().await.unwrap(), Event::Job { job } if job.id == id && job.state.is_final()) {}
        service.journal.store().flush().await;
        let state = service.job(id).unwrap().state;
        assert_eq!(state == JobState::Cancelled, cancelled, "{state}");
        assert_eq!(service.usual_time_s(&noted).await.is_some_and(|time_s| time_s > 0.0), known);
        assert_eq!(service.usual_time_s(&focus).await, None);
        // A plan says what it took; where there was none, what is worked out.
        let mut plan = PlanView::of(service.config(), &ConfigOrigin::Preset);
        (plan.parts[0].kind, plan.parts[0].duration_s) = (JobKind::Homing, 1e6);
        let told = service.as_it_usually_took(plan.clone()).await;
        assert_eq!(told.parts[0].duration_s, service.usual_time_s(&homing).await.unwrap_or(1e6));
        (plan.parts[0].duration_s, plan.parts[0].kind) = (told.parts[0].duration_s, told.parts[0].kind);
        assert_eq!(told, plan);
    }
}
