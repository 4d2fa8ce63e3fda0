//! Who may talk to the server: whoever knows its token, from a page that it served itself, under the address that it has.
//!
//! A page of another site can make a browser send requests to this machine. Such a request does not know the token, its `Origin` is
//! the other site's, and where its name was pointed at this machine (DNS rebinding) its `Host` is that name.

use std::fmt::Write;
use std::net::SocketAddr;

use rand::rand_core::UnwrapErr;
use rand::{Rng, rngs::SysRng};

/// Bytes of a token: not to be guessed.
const TOKEN_BYTES: usize = 16;

/// A word that is known to those only who were told: 32 hexadecimal digits from the operating system's generator.
pub(super) fn token() -> String {
    let mut bytes = [0; TOKEN_BYTES];
    UnwrapErr(SysRng).fill_bytes(&mut bytes);
    let mut token = String::with_capacity(2 * TOKEN_BYTES);
    for byte in bytes {
        let _ = write!(token, "{byte:02x}");
    }
    token
}

/// The rules at a door.
#[derive(Clone, Debug)]
pub(super) struct Guard {
    token: String,
    hosts: [String; 2],
}

/// What a request says of where it comes from and what it wants.
#[derive(Clone, Copy, Debug)]
pub(super) struct Request<'r> {
    pub path: &'r str,
    pub host: Option<&'r str>,
    pub origin: Option<&'r str>,
}

/// Why a request is turned away.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Refusal {
    /// It is for another host.
    Host,
    /// Another site's page sent it.
    Origin,
    /// It does not know the token.
    Token,
}

impl Refusal {
    pub fn reason(self) -> &'static str {
        match self {
            Self::Host => "this server answers under its own address only",
            Self::Origin => "a page of another site may not ask here",
            Self::Token => "the address lacks the token that `tdcr view` printed",
        }
    }
}

impl Guard {
    pub fn new(address: SocketAddr, token: &str) -> Self {
        let port = address.port();
        Self {
            token: token.to_owned(),
            hosts: [format!("127.0.0.1:{port}"), format!("localhost:{port}")],
        }
    }

    /// What a request asks for, behind the token.
    pub fn admit<'r>(&self, request: Request<'r>) -> Result<&'r str, Refusal> {
        let is_own = |host: &str| self.hosts.iter().any(|own| own == host);
        if !request.host.is_some_and(is_own) {
            return Err(Refusal::Host);
        }
        // Programs send none; a browser does wherever it matters.
        let is_foreign = |origin: &str| !origin.strip_prefix("http://").is_some_and(is_own);
        if request.origin.is_some_and(is_foreign) {
            return Err(Refusal::Origin);
        }
        let (token, rest) = request
            .path
            .strip_prefix('/')
            .and_then(|path| path.split_once('/'))
            .ok_or(Refusal::Token)?;
        match same(token, &self.token) {
            true => Ok(rest),
            false => Err(Refusal::Token),
        }
    }
}

/// Whether two words are the same, found in a time that does not tell how much of them is.
fn same(one: &str, other: &str) -> bool {
    let pairs = one.bytes().zip(other.bytes());
    one.len() == other.len() && pairs.fold(0, |sum, (a, b)| sum | (a ^ b)) == 0
}

#[cfg(test)]
mod tests {
    use super::{Guard, Refusal, Request, token};

    fn admit<'r>(
        path: &'r str,
        host: Option<&'r str>,
        origin: Option<&'r str>,
    ) -> Result<&'r str, Refusal> {
        let guard = Guard::new(([127, 0, 0, 1], 4000).into(), "word");
        guard.admit(Request { path, host, origin })
    }

    #[test]
    fn who_knows_the_token_is_let_in_from_the_servers_own_pages() {
        let host = Some("127.0.0.1:4000");
        assert_eq!(admit("/word/", host, None), Ok(""));
        assert_eq!(
            admit("/word/main.js", host, Some("http://127.0.0.1:4000")),
            Ok("main.js")
        );
        let named = Some("localhost:4000");
        assert_eq!(
            admit("/word/socket", named, Some("http://localhost:4000")),
            Ok("socket")
        );
    }

    #[test]
    fn other_tokens_hosts_and_origins_are_turned_away() {
        let host = Some("127.0.0.1:4000");
        for path in [
            "/", "/word", "/wor/", "/words/", "/Word/", "word/", "//word/",
        ] {
            assert_eq!(admit(path, host, None), Err(Refusal::Token), "{path}");
        }
        for host in [
            None,
            Some("127.0.0.1"),
            Some("127.0.0.1:4001"),
            Some("evil.example:4000"),
            Some("0.0.0.0:4000"),
        ] {
            assert_eq!(admit("/word/", host, None), Err(Refusal::Host), "{host:?}");
        }
        for origin in [
            "null",
            "http://evil.example",
            "https://127.0.0.1:4000",
            "http://127.0.0.1:4001",
            "http://127.0.0.1:4000.evil.example",
        ] {
            let refused = admit("/word/", host, Some(origin));
            assert_eq!(refused, Err(Refusal::Origin), "{origin}");
        }
    }

    #[test]
    fn tokens_are_long_and_never_the_same() {
        let (one, other) = (token(), token());
        assert_eq!(one.len(), 32);
        assert_ne!(one, other);
    }
}
