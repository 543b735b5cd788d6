//! burn's devices by name.

use crate::{DenoiseError, TrainDevice};
use burn::tensor::Device;

impl TrainDevice {
    /// Opens the device with automatic differentiation.
    ///
    /// # Errors
    /// [`DenoiseError::NotBuilt`], [`DenoiseError::NoDevice`].
    pub fn open(self) -> Result<Device, DenoiseError> {
        // the first tensor on a missing device would panic
        #[cfg(any(feature = "cuda", feature = "wgpu"))]
        let present = |kind: burn::tensor::DeviceType, device: Device| match Device::enumerate(kind)
            .is_empty()
        {
            true => Err(DenoiseError::NoDevice { device: self.name() }),
            false => Ok(device.autodiff()),
        };
        match self {
            Self::Flex => Ok(Device::flex().autodiff()),
            #[cfg(feature = "cuda")]
            Self::Cuda => present(burn::tensor::DeviceType::Cuda, Device::cuda(0)),
            #[cfg(feature = "wgpu")]
            Self::Wgpu => present(burn::tensor::DeviceType::Wgpu, Device::wgpu(Default::default())),
            #[cfg(not(all(feature = "cuda", feature = "wgpu")))]
            _ => Err(DenoiseError::NotBuilt { device: self.name() }),
        }
    }
}
