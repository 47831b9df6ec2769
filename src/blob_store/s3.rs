//! A depot that is a prefix of a bucket, and objects of a bucket that are read by ranges.
//!
//! Everything waits for its answer: the asynchronous client runs on one thread of its own. A request that fails for the network's or the
//! store's sake is made again, with longer and longer pauses, for about half a minute.

use std::cell::Cell;
use std::future::Future;
use std::io::{self, ErrorKind};
use std::mem;
use std::ops::Range;
use std::path::Path as FilePath;
use std::process;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use object_store::aws::{AmazonS3, AmazonS3Builder, AmazonS3ConfigKey};
use object_store::client::{ClientConfigKey, HttpError, HttpErrorKind};
use object_store::list::{PaginatedListOptions, PaginatedListStore};
use object_store::path::Path;
use object_store::{BackoffConfig, GetOptions, ObjectStore, RetryConfig};
use tokio::runtime::{Builder, Runtime};
use tokio::task::JoinHandle;

use super::read_ahead::{Ahead, HELD_BYTES};
use crate::error::{Error, Result};
use crate::files::{Ranged, check_free_space, replace};

/// Retries of a request that the store refuses temporarily, or that does not reach it; then the pauses: the first, the
/// longest, and the largest ratio of one to the one before. All pauses together take about half a minute, give or take
/// a half.
const RETRIES: usize = 10;
const FIRST_PAUSE: Duration = Duration::from_millis(250);
const MAX_PAUSE: Duration = Duration::from_secs(8);
const GROWTH: f64 = 3.0;
/// Where machines of the cloud ask for their own credentials, when the environment names none.
const MACHINE_CREDENTIALS: &str = "169.254.169.254";
/// Tries of an operation whose answer the client did not get whole, or did not understand, which it makes no retries for.
const TRIES: u32 = 4;
/// How long tries may have taken for another: where the answer broke off, and where the store may have meant what it said.
const BROKEN_OFF: Duration = Duration::from_secs(60);
const NOT_UNDERSTOOD: Duration = Duration::from_secs(5);
/// Characters of what a store says that are repeated in a message.
const MAX_SHOWN_CHARACTERS: usize = 400;

/// The threads of this process's client, by its id: in a forked child the parent's are not there.
static RUNTIME: Mutex<Option<(u32, &'static Runtime)>> = Mutex::new(None);

fn runtime() -> Result<&'static Runtime> {
    let mut held = RUNTIME.lock().unwrap_or_else(PoisonError::into_inner);
    match *held {
        Some((id, runtime)) if id == process::id() => Ok(runtime),
        _ => {
            // Rustls is told once which arithmetic to use; that it was told before is no matter.
            let _ = rustls::crypto::ring::default_provider().install_default();
            let made = Builder::new_multi_thread().worker_threads(1).thread_name("ltm s3").enable_all().build();
            let made = made.map_err(Error::io("the client of object stores", "start"))?;
            let runtime: &'static Runtime = Box::leak(Box::new(made));
            *held = Some((process::id(), runtime));
            Ok(runtime)
        }
    }
}

async fn again_where_it_broke_off<T, F>(
    client: Arc<AmazonS3>,
    ask: impl Fn(Arc<AmazonS3>) -> F,
) -> object_store::Result<T>
where
    F: Future<Output = object_store::Result<T>>,
{
    let begun = Instant::now();
    for number in 1.. {
        match ask(client.clone()).await {
            Err(error) if number < TRIES && begun.elapsed() < patience(&error) => {
                tokio::time::sleep(Duration::from_millis(200) * number * number).await;
            }
            done => return done,
        }
    }
    unreachable!("the numbers do not end")
}

/// A bucket, and a prefix of names in it.
#[derive(Debug)]
pub(super) struct Bucket {
    /// `s3://BUCKET/PREFIX`, for messages.
    address: String,
    name: String,
    /// Without slashes at its ends; may be empty.
    prefix: String,
    /// By the id of the process, whose connections it holds.
    client: Mutex<Option<(u32, Arc<AmazonS3>)>>,
}

impl Bucket {
    /// # Errors
    /// An address that is none; settings that are missing or cannot be used.
    pub(super) fn new(address: &str) -> Result<Self> {
        let refuse = |problem: &str| Err(Error::input(address, problem, "write s3://BUCKET/PREFIX"));
        let Some((name, prefix)) = address.strip_prefix("s3://").map(|rest| rest.split_once('/').unwrap_or((rest, "")))
        else {
            return refuse("is no address of an object store");
        };
        if name.is_empty() {
            return refuse("names no bucket");
        }
        let prefix = prefix.trim_matches('/').to_owned();
        if let Err(error) = Path::parse(&prefix) {
            return refuse(&format!("is no usable prefix ({error})"));
        }
        let this = Self { address: address.to_owned(), name: name.to_owned(), prefix, client: Mutex::new(None) };
        this.client()?;
        Ok(this)
    }

    /// The client of this process.
    fn client(&self) -> Result<Arc<AmazonS3>> {
        let mut held = self.client.lock().unwrap_or_else(PoisonError::into_inner);
        match held.take() {
            Some((id, client)) if id == process::id() => {
                *held = Some((id, client.clone()));
                Ok(client)
            }
            other => {
                // Its connections are the parent's.
                mem::forget(other);
                // Which chooses the arithmetic of its connections.
                runtime()?;
                let client = Arc::new(self.connect()?);
                *held = Some((process::id(), client.clone()));
                Ok(client)
            }
        }
    }

    fn connect(&self) -> Result<AmazonS3> {
        let backoff = BackoffConfig { init_backoff: FIRST_PAUSE, max_backoff: MAX_PAUSE, base: GROWTH };
        let retry = RetryConfig { backoff, max_retries: RETRIES, retry_timeout: 2 * BROKEN_OFF };
        let builder = AmazonS3Builder::from_env().with_bucket_name(&self.name).with_retry(retry);
        let value = |key: AmazonS3ConfigKey| builder.get_config_value(&key);
        let endpoint = value(AmazonS3ConfigKey::S3Endpoint).or_else(|| value(AmazonS3ConfigKey::Endpoint));
        let is_open = endpoint.as_ref().is_some_and(|endpoint| endpoint.starts_with("http://"));
        let may_be_open = value(AmazonS3ConfigKey::Client(ClientConfigKey::AllowHttp));
        if is_open && !may_be_open.is_some_and(|word| word == "true" || word == "1") {
            let problem = format!("{} is not encrypted", endpoint.unwrap_or_default());
            return Err(Error::input("AWS_ENDPOINT_URL", problem, "take https, or allow it by AWS_ALLOW_HTTP=true"));
        }
        let refuse =
            |error| Error::input(&self.address, said_by(&error), "look at the AWS_ variables of the environment");
        builder.build().map_err(refuse)
    }

    pub(super) fn address_of(&self, name: &str) -> String {
        let end = if self.prefix.is_empty() { name.to_owned() } else { format!("{}/{name}", self.prefix) };
        format!("s3://{}/{end}", self.name)
    }

    pub(super) fn key(&self, name: &str) -> Result<Path> {
        let text = if self.prefix.is_empty() { name.to_owned() } else { format!("{}/{name}", self.prefix) };
        Path::parse(text)
            .map_err(|e| Error::input(self.address_of(name), format!("is no usable name ({e})"), "rename it"))
    }

    /// Does something with the store, and again where its answer broke off. `action` on `address` is what messages name.
    pub(super) fn ask<T, F>(&self, address: &str, action: &str, ask: impl Fn(Arc<AmazonS3>) -> F) -> Result<T>
    where
        F: Future<Output = object_store::Result<T>>,
    {
        let asking = again_where_it_broke_off(self.client()?, ask);
        runtime()?.block_on(asking).map_err(|error| refusal(address, action, &error))
    }

    /// Begins to do something with the store, as [`ask`](Self::ask) does it.
    pub(super) fn begin<T, F>(
        &self,
        ask: impl Fn(Arc<AmazonS3>) -> F + Send + Sync + 'static,
    ) -> Result<JoinHandle<object_store::Result<T>>>
    where
        F: Future<Output = object_store::Result<T>> + Send + 'static,
        T: Send + 'static,
    {
        Ok(runtime()?.spawn(again_where_it_broke_off(self.client()?, ask)))
    }

    /// Waits for what was begun.
    pub(super) fn end<T>(&self, begun: JoinHandle<object_store::Result<T>>, address: &str, action: &str) -> Result<T> {
        let ended = runtime()?.block_on(begun).map_err(|e| Error::io(address, action)(io::Error::other(e)))?;
        ended.map_err(|error| refusal(address, action, &error))
    }

    pub(super) fn names(&self, beginning: &str) -> Result<Vec<String>> {
        let before = if self.prefix.is_empty() { String::new() } else { format!("{}/", self.prefix) };
        let whole = format!("{before}{beginning}");
        let (mut names, mut token) = (Vec::new(), None);
        loop {
            let page = self.ask(&self.address, "look into", |client| {
                let (whole, page_token) = (whole.clone(), token.clone());
                async move {
                    let options =
                        PaginatedListOptions { delimiter: Some("/".into()), page_token, ..Default::default() };
                    client.list_paginated(Some(&*whole).filter(|text| !text.is_empty()), options).await
                }
            })?;
            let found = page.result.objects.iter().filter_map(|object| object.location.as_ref().strip_prefix(&*before));
            names.extend(found.map(str::to_owned));
            token = page.page_token;
            if token.is_none() {
                return Ok(names);
            }
        }
    }

    /// A copy of an object in a file, unless the file is there.
    pub(super) fn copy(self: &Arc<Self>, name: &str, path: &FilePath) -> Result<()> {
        if path.exists() {
            return Ok(());
        }
        let object = Object::open(self.clone(), name)?;
        check_free_space(path, object.bytes)?;
        let mut buffer = vec![0; 1 << 20];
        replace(path, true, |file| {
            let mut offset = 0;
            while offset < object.bytes {
                let step = (object.bytes - offset).min(buffer.len() as u64) as usize;
                object.read(&mut buffer[..step], offset)?;
                io::Write::write_all(file, &buffer[..step]).map_err(Error::io(path, "write"))?;
                offset += step as u64;
            }
            Ok(())
        })
    }
}

/// An object as it was when it was opened; one that was replaced since cannot be read.
#[derive(Debug)]
pub(super) struct Object {
    bucket: Arc<Bucket>,
    address: String,
    key: Path,
    bytes: u64,
    e_tag: Option<String>,
    ahead: Ahead,
}

impl Object {
    /// # Errors
    /// It is not there; the store refuses.
    pub(super) fn open(bucket: Arc<Bucket>, name: &str) -> Result<Self> {
        let (key, address) = (bucket.key(name)?, bucket.address_of(name));
        let found = bucket.ask(&address, "open", |client| {
            let key = key.clone();
            async move { client.get_opts(&key, GetOptions { head: true, ..Default::default() }).await }
        })?;
        let (bytes, e_tag) = (found.meta.size, found.meta.e_tag);
        Ok(Self { bucket, address, key, bytes, e_tag, ahead: Ahead::default() })
    }

    fn read(&self, buffer: &mut [u8], offset: u64) -> Result<()> {
        let end = offset.saturating_add(buffer.len() as u64);
        if end > self.bytes {
            let problem = format!("ends after {} bytes, and {end} were wanted", self.bytes);
            return Err(Error::input(&self.address, problem, "fetch it again if it was copied"));
        }
        // What `fill` hands on is an error of the system; the one of the house is kept beside it.
        let refused = Cell::new(None);
        let fetch = |range: Range<u64>| {
            self.fetch(range).map_err(|error| {
                refused.set(Some(error));
                io::Error::from(ErrorKind::Other)
            })
        };
        let filled = self.ahead.fill(buffer, offset, self.bytes, &fetch);
        match refused.into_inner() {
            Some(error) => Err(error),
            None => filled.map_err(Error::io(&self.address, "read")),
        }
    }

    fn fetch(&self, range: Range<u64>) -> Result<Vec<u8>> {
        let action = format!("read {} bytes at {}", range.end - range.start, range.start);
        self.bucket.ask(&self.address, &action, |client| {
            let (key, range, if_match) = (self.key.clone(), range.clone(), self.e_tag.clone());
            async move {
                let wanted = range.end - range.start;
                let options = GetOptions { range: Some(range.into()), if_match, ..Default::default() };
                let bytes = client.get_opts(&key, options).await?.bytes().await?;
                match bytes.len() as u64 == wanted {
                    true => Ok(bytes.to_vec()),
                    false => Err(object_store::Error::Generic {
                        store: "S3",
                        source: Box::new(Short { wanted, found: bytes.len() }),
                    }),
                }
            }
        })
    }
}

impl Ranged for Object {
    fn bytes(&self) -> io::Result<u64> {
        Ok(self.bytes)
    }

    fn fill(&self, buffer: &mut [u8], offset: u64) -> io::Result<()> {
        self.read(buffer, offset).map_err(|error| match error {
            Error::Io { source, .. } => source,
            other => io::Error::other(other),
        })
    }

    fn held_bytes(&self) -> u64 {
        HELD_BYTES
    }
}

/// An answer that is not of the length that was asked for.
#[derive(Debug, thiserror::Error)]
#[error("{found} bytes came in place of {wanted}")]
struct Short {
    wanted: u64,
    found: usize,
}

/// The causes of an error, itself first.
fn causes<'a>(
    error: &'a (dyn std::error::Error + 'static),
) -> impl Iterator<Item = &'a (dyn std::error::Error + 'static)> {
    std::iter::successors(Some(error), |error| error.source())
}

/// How long tries that ended so may have taken for another to be made.
fn patience(error: &object_store::Error) -> Duration {
    if !matches!(error, object_store::Error::Generic { .. }) {
        return Duration::ZERO;
    }
    let of_cause = |cause: &(dyn std::error::Error + 'static)| match cause.downcast_ref::<HttpError>() {
        // The client has tried often enough.
        Some(http) if http.kind() == HttpErrorKind::Connect => Some(Duration::ZERO),
        Some(_) => Some(BROKEN_OFF),
        None => cause.is::<Short>().then_some(BROKEN_OFF),
    };
    causes(error).find_map(of_cause).unwrap_or(NOT_UNDERSTOOD)
}

/// What an error says, as one line of bounded length.
fn said_by(error: &object_store::Error) -> String {
    // The last of the causes says it shortest; what came before is which request it was.
    let text = match error {
        object_store::Error::Generic { source, .. } => source.to_string(),
        other => other.to_string(),
    };
    let mut deepest = causes(error).last().map(ToString::to_string).unwrap_or_default();
    if text.contains(&deepest) {
        deepest.clear();
    }
    let text = if deepest.is_empty() { text } else { format!("{text}: {deepest}") };
    let words = text.split_whitespace().collect::<Vec<_>>().join(" ");
    // What we set ourselves.
    let words = words.replace(&format!(", max_retries: {RETRIES}, retry_timeout: {}s", 2 * BROKEN_OFF.as_secs()), "");
    match words.char_indices().nth(MAX_SHOWN_CHARACTERS) {
        Some((end, _)) => format!("{}…", &words[..end]),
        None => words,
    }
}

/// The error of the house for one of the store: what, where, what to do.
fn refusal(address: &str, action: &str, error: &object_store::Error) -> Error {
    use object_store::Error as Of;
    let is_far = causes(error)
        .filter_map(|cause| cause.downcast_ref::<HttpError>())
        .any(|http| matches!(http.kind(), HttpErrorKind::Connect | HttpErrorKind::Timeout));
    let (kind, text) = match error {
        Of::NotFound { .. } => (ErrorKind::NotFound, "there is no such bucket or object; look at the name".to_owned()),
        Of::PermissionDenied { .. } | Of::Unauthenticated { .. } => {
            let hint = "look at AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, and what they may do there";
            (ErrorKind::PermissionDenied, format!("{}; {hint}", said_by(error)))
        }
        Of::Precondition { .. } => {
            (ErrorKind::InvalidData, "it was replaced while it was read; open it again".to_owned())
        }
        _ if error.to_string().contains(MACHINE_CREDENTIALS) => {
            let hint = "set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or AWS_SKIP_SIGNATURE=true for what is public";
            (
                ErrorKind::PermissionDenied,
                format!("the environment has no credentials, and this machine none of its own; {hint}"),
            )
        }
        _ if is_far => {
            let hint = "look at the network, AWS_ENDPOINT_URL and AWS_REGION, then run the same again";
            (ErrorKind::TimedOut, format!("{}; {hint}", said_by(error)))
        }
        _ => (
            ErrorKind::Other,
            format!("{}; it goes on when the store answers and the same is run again", said_by(error)),
        ),
    };
    Error::io(address, action)(io::Error::new(kind, text))
}
