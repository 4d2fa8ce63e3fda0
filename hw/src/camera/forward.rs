//! What a camera that stands before another leaves as it is.

/// Within an `impl RgbdCamera`: all but [`grab_after`](super::RgbdCamera::grab_after) is that of the camera `$inner`.
macro_rules! described_by {
    (|$this:ident| $inner:expr) => {
        fn serial(&self) -> &str {
            let $this = self;
            $inner.serial()
        }

        fn camera(&self) -> &tdcr_sim::camera::Camera {
            let $this = self;
            $inner.camera()
        }

        fn depth_to_color(&self) -> nalgebra::Isometry3<f64> {
            let $this = self;
            $inner.depth_to_color()
        }

        fn usb(&self) -> Option<$crate::camera::UsbVersion> {
            let $this = self;
            $inner.usb()
        }

        fn clock(&self) -> &std::sync::Arc<dyn $crate::clock::Clock> {
            let $this = self;
            $inner.clock()
        }
    };
}

pub(crate) use described_by;
