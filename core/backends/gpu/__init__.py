"""Any maker's graphics card, through WebGPU (wgpu-py: Vulkan, Metal, DirectX 12): no compiler, no toolkit, one wheel.

adapter         which card there is, and why not
card            one card: memory, compiled shaders, orders, and what crosses the bus
shader_text     shaders/*.wgsl, and the constants they share with Python
tensors         torch tensors whose values lie in the card's memory; torch's device is called 'gpu'
operands        tensors as shaders see them: steps along axes, plain numbers, truth values, complex numbers
arithmetic      torch's operations on values one by one;  reductions, rows: along axes, and on rows of tables
transforms      Fourier transforms, and frames grown at their borders
blurs           separable and tap by tap, with their transposes
losses          MAE + SSIM with masks, variation, specks
sorting         prefix sums and the radix sort
rasterizer      Gaussians and a camera in, an image out, and its gradient
ready           what the first steps would wait for, done before
backend         what `core.devices` asks of a back end
"""
