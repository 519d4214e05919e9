//! A store in which named writes go wrong on demand.

use std::collections::HashMap;
use std::future::Future;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use mapfit::store::{Records, StoreError};

/// What goes wrong at a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Fault {
    /// The connection is reset before the write.
    Before,
    /// The write is committed, and its answer lost.
    After,
    /// The write comes late: the lease may have lapsed by then.
    Late(Duration),
}

impl Fault {
    pub fn all(late: Duration) -> [Self; 3] {
        [Self::Before, Self::After, Self::Late(late)]
    }
}

/// The real store, and how often which fault is still to come at each point.
pub struct Faulty {
    pub inner: Arc<dyn Records>,
    planned: Mutex<HashMap<&'static str, (Fault, usize)>>,
}

impl Faulty {
    pub fn new(inner: Arc<dyn Records>) -> Self {
        Self { inner, planned: Mutex::default() }
    }

    /// The next `times` passes of a point go wrong.
    pub fn plan(&self, point: &'static str, fault: Fault, times: usize) {
        self.planned.lock().unwrap().insert(point, (fault, times));
    }

    /// How many planned faults at a point have not come.
    pub fn left(&self, point: &str) -> usize {
        self.planned.lock().unwrap().get(point).map_or(0, |planned| planned.1)
    }

    /// A write at a named point.
    pub async fn at<T>(
        &self,
        point: &str,
        write: impl Future<Output = Result<T, StoreError>>,
    ) -> Result<T, StoreError> {
        let reset = || StoreError::Database(sqlx::Error::Io(std::io::ErrorKind::ConnectionReset.into()));
        let fault = self.planned.lock().unwrap().get_mut(point).filter(|planned| planned.1 > 0).map(|planned| {
            planned.1 -= 1;
            planned.0
        });
        match fault {
            None => write.await,
            Some(Fault::Before) => Err(reset()),
            Some(Fault::After) => {
                write.await?;
                Err(reset())
            }
            Some(Fault::Late(by)) => {
                tokio::time::sleep(by).await;
                write.await
            }
        }
    }
}
