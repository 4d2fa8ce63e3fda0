//! Plans, estimation and control of tendon-driven continuum robots: whatever can be measured and commanded, simulated or on the
//! desk. It uses the simulator ([`tdcr_sim`]) and knows neither servos and cameras nor learners.
