//! The command socket of the cell, for a gateway that waits for it with everything else.

use crate::supervisor::protocol::{Answer, Request};
use anyhow::{Context as _, Result, bail};
use std::path::PathBuf;
use std::time::Duration;
use tokio::io::{AsyncBufReadExt as _, AsyncReadExt as _, AsyncWriteExt as _, BufReader};
use tokio::net::UnixStream;

/// Longest wait for an answer; the cell itself answers within 10 s.
const TIMEOUT: Duration = Duration::from_secs(12);

/// Longest answer, bytes: 64 results with 1 MB of features at most, as the cell keeps them.
const MAX_ANSWER: u64 = 64 << 20;

/// One connection to the cell.
pub struct Link(BufReader<UnixStream>);

impl Link {
    /// Connects to a cell.
    ///
    /// # Errors
    /// No cell listens.
    pub async fn open(socket: &PathBuf) -> Result<Self> {
        Ok(Self(BufReader::new(UnixStream::connect(socket).await?)))
    }

    /// Sends a request and waits for its answer.
    ///
    /// # Errors
    /// The cell ended or does not answer.
    pub async fn ask(&mut self, request: &Request) -> Result<Answer> {
        let mut line = serde_json::to_vec(request)?;
        line.push(b'\n');
        tokio::time::timeout(TIMEOUT, self.exchange(&line)).await.context("the cell does not answer")?
    }

    async fn exchange(&mut self, line: &[u8]) -> Result<Answer> {
        self.0.get_mut().write_all(line).await?;
        let mut answer = Vec::new();
        (&mut self.0).take(MAX_ANSWER).read_until(b'\n', &mut answer).await?;
        if answer.last() != Some(&b'\n') {
            bail!("the cell ended before it answered");
        }
        Ok(serde_json::from_slice(&answer)?)
    }
}
