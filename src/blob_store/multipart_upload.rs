//! Writing an object: small ones by one request, others in parts, which the store makes one object of at the end. Either way it is there
//! whole or not at all.

use std::collections::VecDeque;
use std::io::{self, ErrorKind, Write};
use std::mem;

use object_store::multipart::{MultipartStore, PartId};
use object_store::path::Path;
use object_store::{MultipartId, ObjectStore, PutPayload};
use tokio::task::JoinHandle;

use super::Content;
use super::s3::Bucket;
use crate::error::{Error, Result};

/// Bytes of a part but the last; stores take ten thousand of them, of five mebibytes at least.
const PART_BYTES: usize = 16 << 20;
/// Tries of a whole object in parts of which the end was refused: its beginning may have been forgotten.
const TRIES: usize = 3;
/// Parts that are under way at most.
const FLYING: usize = 3;
/// Memory that writing takes at most: a part that is filled, and those under way, of which one may be held twice.
pub(super) const HELD_BYTES: u64 = (FLYING as u64 + 2) * PART_BYTES as u64;

/// An object that is being written.
pub(super) struct Upload<'a> {
    bucket: &'a Bucket,
    address: String,
    key: Path,
    waiting: Vec<u8>,
    /// Once there is more than one part.
    parts: Option<Parts>,
    /// What the store refused, which a writer can tell as an error of the system only.
    refused: Option<Error>,
}

/// Parts of an object, those under way after those that have landed.
struct Parts {
    id: MultipartId,
    landed: Vec<PartId>,
    flying: VecDeque<JoinHandle<object_store::Result<PartId>>>,
}

impl<'a> Upload<'a> {
    /// Writes an object.
    ///
    /// # Errors
    /// Those of `content` and of the store.
    pub(super) fn put(bucket: &'a Bucket, name: &str, content: Content) -> Result<()> {
        let (key, address) = (bucket.key(name)?, bucket.address_of(name));
        for number in 1.. {
            let (key, address) = (key.clone(), address.clone());
            let mut upload = Self { bucket, address, key, waiting: Vec::new(), parts: None, refused: None };
            let written = content(&mut upload);
            let written = match upload.refused.take() {
                Some(error) => Err(error),
                None => written,
            };
            let Err(error) = written.and_then(|()| upload.finish()) else { return Ok(()) };
            upload.abort();
            // The store knows nothing of the parts: that the object was made and the answer lost, or that they were dropped.
            let is_lost = matches!(&error, Error::Io { source, .. } if source.kind() == ErrorKind::NotFound);
            if !(is_lost && upload.parts.is_some() && number < TRIES) {
                return Err(error);
            }
        }
        unreachable!("the numbers do not end")
    }

    /// Sends the part that waits, once there is room for it among those under way.
    fn send_part(&mut self) -> Result<()> {
        self.land(FLYING - 1)?;
        let payload = PutPayload::from(mem::take(&mut self.waiting));
        let parts = match &mut self.parts {
            Some(parts) => parts,
            none => {
                let id = self.bucket.ask(&self.address, "begin", |client| {
                    let key = self.key.clone();
                    async move { client.create_multipart(&key).await }
                })?;
                none.insert(Parts { id, landed: Vec::new(), flying: VecDeque::new() })
            }
        };
        let (key, id, number) = (self.key.clone(), parts.id.clone(), parts.landed.len() + parts.flying.len());
        parts.flying.push_back(self.bucket.begin(move |client| {
            let (key, id, payload) = (key.clone(), id.clone(), payload.clone());
            async move { client.put_part(&key, &id, number, payload).await }
        })?);
        Ok(())
    }

    /// Waits until at most so many parts are under way.
    fn land(&mut self, most: usize) -> Result<()> {
        let Some(Parts { landed, flying, .. }) = &mut self.parts else { return Ok(()) };
        while flying.len() > most
            && let Some(begun) = flying.pop_front()
        {
            let action = format!("write part {}", landed.len() + 1);
            landed.push(self.bucket.end(begun, &self.address, &action)?);
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<()> {
        if self.parts.is_none() {
            let payload = PutPayload::from(mem::take(&mut self.waiting));
            return self.bucket.ask(&self.address, "write", |client| {
                let (key, payload) = (self.key.clone(), payload.clone());
                async move { client.put_opts(&key, payload, Default::default()).await.map(drop) }
            });
        }
        if !self.waiting.is_empty() {
            self.send_part()?;
        }
        self.land(0)?;
        let Some(Parts { id, landed, .. }) = &self.parts else { return Ok(()) };
        self.bucket.ask(&self.address, "complete", |client| {
            let (key, id, parts) = (self.key.clone(), id.clone(), landed.clone());
            async move { client.complete_multipart(&key, &id, parts).await.map(drop) }
        })
    }

    /// Has the store drop parts of an object that was not completed. Where it does not answer its own rules do so, some day.
    fn abort(&mut self) {
        // What lands after its object was dropped would stay.
        for begun in self.parts.iter_mut().flat_map(|parts| parts.flying.drain(..)) {
            let _ = self.bucket.end(begun, &self.address, "write");
        }
        if let Some(Parts { id, .. }) = &self.parts {
            let _ = self.bucket.ask(&self.address, "drop the parts of", |client| {
                let (key, id) = (self.key.clone(), id.clone());
                async move { client.abort_multipart(&key, &id).await }
            });
        }
    }
}

impl Write for Upload<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.waiting.capacity() == 0 {
            self.waiting.reserve_exact(PART_BYTES.min(bytes.len().max(1 << 20)));
        }
        let step = bytes.len().min(PART_BYTES - self.waiting.len());
        self.waiting.extend_from_slice(&bytes[..step]);
        if self.waiting.len() == PART_BYTES
            && let Err(error) = self.send_part()
        {
            self.refused = Some(error);
            return Err(io::Error::from(ErrorKind::Other));
        }
        Ok(step)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}
