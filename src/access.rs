//! API keys: `mapfit_ID_SECRET`, the secret 256 random bits.
//!
//! The id finds the record; the SHA-256 of the whole key is what is kept, and compared in constant time. A secret this
//! long needs no slow hash: there is nothing to guess.

use base64::Engine;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use sha2::{Digest, Sha256};
use subtle::ConstantTimeEq;

use crate::store::{ApiKey, NewKey};

const PREFIX: &str = "mapfit";

/// A new key, and its record. The operating system's random numbers may fail.
pub fn new_key(tenant: &str, name: Option<&str>, scopes: &[&str]) -> Result<(String, NewKey), getrandom::Error> {
    let (mut id, mut secret) = ([0; 8], [0; 32]);
    getrandom::fill(&mut id)?;
    getrandom::fill(&mut secret)?;
    let id = hex::encode(id);
    let key = format!("{PREFIX}_{id}_{}", URL_SAFE_NO_PAD.encode(secret));
    let scopes = scopes.iter().map(|scope| (*scope).to_owned()).collect();
    let sha256 = Sha256::digest(&key).into();
    Ok((key, NewKey { id, tenant: tenant.into(), name: name.map(str::to_owned), scopes, sha256 }))
}

/// The id of what looks like a key.
pub fn id_of(key: &str) -> Option<&str> {
    let (id, _) = key.strip_prefix(PREFIX)?.strip_prefix('_')?.split_once('_')?;
    (id.len() == 16 && id.bytes().all(|byte| byte.is_ascii_hexdigit())).then_some(id)
}

/// Whether a record is that of a key which still opens.
pub fn opens(key: &str, record: &ApiKey) -> bool {
    let digest = Sha256::digest(key);
    bool::from(digest.as_slice().ct_eq(&record.sha256)) && record.revoked.is_none()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_opens_its_own_record_until_it_is_revoked() {
        let (key, new) = new_key("t", None, &["read"]).unwrap();
        let record = ApiKey {
            id: new.id.clone(),
            tenant: new.tenant,
            name: None,
            scopes: new.scopes,
            sha256: new.sha256.to_vec(),
            created: 0,
            revoked: None,
        };
        assert_eq!(id_of(&key), Some(&record.id[..]));
        assert!(opens(&key, &record) && !opens(&format!("{key}x"), &record) && !opens("", &record));
        assert!(!opens(&key, &ApiKey { revoked: Some(1), ..record }));
        for broken in ["", "mapfit", "mapfit_", "mapfit__x", "mapfit_0123456789abcdeg_x", "other_0123456789abcdef_x"] {
            assert_eq!(id_of(broken), None, "{broken}");
        }
    }
}
