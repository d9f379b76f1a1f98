//! Stops that come together: however many they are, rest is proved twice at most.

use std::sync::atomic::{AtomicU64, Ordering};

use tokio::sync::Mutex;

use crate::device::StopDelivery;

/// Proves of a controller, one stop at a time, that it rests. A stop whose order went out while rest is being proved for
/// another waits for the next proof, and shares that with whoever waits, too.
#[derive(Debug, Default)]
pub struct Stopping {
    begun: AtomicU64,
    /// The number of the newest proof, and what came of it.
    proved: Mutex<Option<(u64, StopDelivery)>>,
}

impl Stopping {
    /// Proves rest by `proof`, unless that was done by one that began after this was called.
    pub async fn prove(&self, proof: impl Future<Output = StopDelivery>) -> StopDelivery {
        let asked = self.begun.load(Ordering::SeqCst);
        let mut proved = self.proved.lock().await;
        match *proved {
            Some((number, delivery)) if number > asked => delivery,
            _ => {
                let number = self.begun.fetch_add(1, Ordering::SeqCst) + 1;
                let delivery = proof.await;
                *proved = Some((number, delivery));
                delivery
            }
        }
    }

    /// Waits until rest has been proved for the stops that came before.
    pub async fn ended(&self) {
        drop(self.proved.lock().await);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::time::Duration;

    use tokio::sync::Semaphore;

    use super::*;

    #[tokio::test]
    async fn a_proof_that_began_before_a_stop_is_not_its_own_and_the_next_is_everybodys() {
        let (stopping, allowed, proofs) =
            (Arc::<Stopping>::default(), Arc::new(Semaphore::new(0)), Arc::<AtomicU64>::default());
        let stop = || {
            let (stopping, allowed, proofs) = (Arc::clone(&stopping), Arc::clone(&allowed), Arc::clone(&proofs));
            tokio::spawn(async move {
                let proof = async {
                    proofs.fetch_add(1, Ordering::SeqCst);
                    allowed.acquire().await.unwrap().forget();
                    StopDelivery::Confirmed
                };
                stopping.prove(proof).await
            })
        };
        let first = stop();
        while proofs.load(Ordering::SeqCst) == 0 {
            tokio::task::yield_now().await;
        }
        let others: Vec<_> = (0..1000).map(|_| stop()).collect();
        tokio::task::yield_now().await;
        allowed.add_permits(1);
        assert_eq!(first.await.unwrap(), StopDelivery::Confirmed);
        while proofs.load(Ordering::SeqCst) == 1 {
            tokio::task::yield_now().await;
        }
        assert!(others.iter().all(|other| !other.is_finished()), "the first one's proof began before they stopped");
        allowed.add_permits(1);
        for other in others {
            let delivery = tokio::time::timeout(Duration::from_secs(20), other).await.expect("it is shared").unwrap();
            assert_eq!(delivery, StopDelivery::Confirmed);
        }
        assert_eq!(proofs.load(Ordering::SeqCst), 2);
    }
}
