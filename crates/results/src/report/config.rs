//! Settings of the report.

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Content of the report.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ReportConfig {
    /// Whether `report.html` is written.
    pub page: bool,
}

impl Default for ReportConfig {
    fn default() -> Self {
        Self { page: true }
    }
}
