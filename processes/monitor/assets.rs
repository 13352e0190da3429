//! The files of the page, which are part of the program: nothing is loaded from a network.

/// A file of the page.
pub struct Asset {
    /// Where it is served.
    pub path: &'static str,
    /// Content type as the browser needs it.
    pub kind: &'static str,
    /// The bytes as they are sent.
    pub bytes: &'static [u8],
    /// Whether the bytes are compressed with gzip.
    pub gzip: bool,
}

const fn script(path: &'static str, text: &'static str) -> Asset {
    Asset { path, kind: "text/javascript; charset=utf-8", bytes: text.as_bytes(), gzip: false }
}

/// All files. How three.js was packed stands in `docs/page.md`.
pub static ASSETS: [Asset; 10] = [
    Asset {
        path: "/",
        kind: "text/html; charset=utf-8",
        bytes: include_bytes!("page/index.html"),
        gzip: false,
    },
    Asset {
        path: "/page.css",
        kind: "text/css; charset=utf-8",
        bytes: include_bytes!("page/page.css"),
        gzip: false,
    },
    Asset { path: "/icon.svg", kind: "image/svg+xml", bytes: include_bytes!("page/icon.svg"), gzip: false },
    script("/page.js", include_str!("page/page.js")),
    script("/text.js", include_str!("page/text.js")),
    script("/charts.js", include_str!("page/charts.js")),
    script("/cameras.js", include_str!("page/cameras.js")),
    script("/cloud.js", include_str!("page/cloud.js")),
    Asset {
        path: "/three.js",
        kind: "text/javascript; charset=utf-8",
        bytes: include_bytes!("page/three.min.js.gz"),
        gzip: true,
    },
    Asset {
        path: "/three.LICENSE",
        kind: "text/plain; charset=utf-8",
        bytes: include_bytes!("page/three.LICENSE"),
        gzip: false,
    },
];
